//! Rigs known by name: cameras that come without a calibration file.

use cairn_sensor::{Camera, Rig};

/// A rig with a matching number of features.
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
    "a phone's stream of 854x480 pixels: focal length 600, principal point 427, 240; 2000 features",
)];

/// The rig of a name; `None` for an unknown name.
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
    fn every_listed_name_gives_a_valid_rig() {
        for (name, _) in NAMED_RIGS {
            named_rig(name).unwrap().rig.validate().unwrap();
            assert_eq!(crate::read_rig(name).unwrap(), named_rig(name).unwrap().rig);
        }
        assert!(named_rig("phone").is_none());
        assert!(crate::read_rig("phone").is_err());
    }
}
