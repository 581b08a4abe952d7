//! Rigs that are known by name: cameras that come without a calibration of their own.

use cairn_sensor::{Camera, Rig};

/// A rig with what else should be set for it.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedRig {
    /// The rig.
    pub rig: Rig,
    /// Features per image.
    pub features: usize,
}

/// The names that [`named_rig`] knows, and what they stand for.
pub const NAMED_RIGS: [(&str, &str); 1] = [(
    "phone-854x480",
    "a phone's stream of 854x480 pixels: focal length 600, middle at 427, 240; 2000 features",
)];

/// The rig of a name, `None` for a name that is not known.
pub fn named_rig(name: &str) -> Option<NamedRig> {
    match name {
        "phone-854x480" => {
            let camera = Camera::pinhole(854, 480, 600.0, 600.0, 427.0, 240.0);
            Some(NamedRig { rig: Rig::mono(camera), features: 2000 })
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_name_that_is_told_gives_a_rig_that_can_be() {
        for (name, _) in NAMED_RIGS {
            named_rig(name).unwrap().rig.validate().unwrap();
            assert_eq!(crate::read_rig(name).unwrap(), named_rig(name).unwrap().rig);
        }
        assert!(named_rig("phone").is_none());
        assert!(crate::read_rig("phone").is_err());
    }
}
