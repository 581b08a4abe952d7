//! All that is shown, as the messages tell it.

use crate::columns::Columns;
use crate::frames::{BEGIN, WALKER};
use crate::model::Model;
use crate::read::{Malformed, Reader};
use crate::surface::Surface;
use crate::vector::V3;

/// What is shown.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scene {
    /// What it is, for people.
    pub title: String,
    /// Whether lengths are metres.
    pub is_metric: bool,
    /// Points, key frames and routes.
    pub model: Model,
    /// The surface of the depth.
    pub surface: Surface,
    /// Free and occupied spans above the ground.
    pub columns: Columns,
    /// The camera: position, then the axes right, down and forward.
    pub walker: Option<[V3; 4]>,
    /// Messages that were taken.
    pub version: u64,
}

impl Scene {
    /// Takes a message.
    ///
    /// # Errors
    /// One that is damaged, or of a kind that is not known; what it said until then is taken.
    pub fn take(&mut self, message: &[u8]) -> Result<(), Malformed> {
        self.version += 1;
        match message.first() {
            Some(2) => self.model.take(message),
            Some(3) => self.surface.take(message),
            Some(4) => self.columns.take(message),
            Some(&BEGIN) => {
                let title = message.get(2..).ok_or(Malformed::Short)?;
                (self.is_metric, self.title) = (message[1] == 1, String::from_utf8_lossy(title).into_owned());
                Ok(())
            }
            Some(&WALKER) => self.walk(Reader(&message[1..])),
            Some(kind) => Err(Malformed::Kind(*kind)),
            None => Err(Malformed::Short),
        }
    }

    fn walk(&mut self, mut r: Reader) -> Result<(), Malformed> {
        self.walker = None;
        if !r.0.is_empty() {
            self.walker = Some([r.floats()?, r.floats()?, r.floats()?, r.floats()?]);
        }
        r.end()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frames::{begin, walker};

    #[test]
    fn what_is_told_is_there_and_what_is_damaged_is_refused() {
        let mut scene = Scene::default();
        scene.take(&begin("home.map", true)).unwrap();
        scene.take(&walker(Some([[1.0, 2.0, 3.0]; 4]))).unwrap();
        assert_eq!((scene.title.as_str(), scene.walker.map(|w| w[0])), ("home.map", Some([1.0, 2.0, 3.0])));
        scene.take(&walker(None)).unwrap();
        assert_eq!(scene.walker, None);
        assert_eq!(scene.take(&[7, 0, 0]), Err(Malformed::Kind(7)));
        for kind in [2, 3, 4, WALKER] {
            assert_eq!(scene.take(&[kind, 1, 0]), Err(Malformed::Short), "{kind}");
        }
        assert_eq!(scene.take(&[]), Err(Malformed::Short));
        // A block of a submap that is not there, and a corner that no vertex has.
        let one = 1_u32.to_le_bytes();
        let block = |part: u32, corner: u8| {
            let pose = [&one[..], &7_u32.to_le_bytes(), &[0; 48]].concat();
            let head = [&[3, 1, 0, 0][..], &0.02_f32.to_le_bytes(), &[0; 4], &pose, &one].concat();
            let mesh = [&part.to_le_bytes()[..], &[0; 16], &[3, 0, 1, 0], &[0; 18], &[0, 1, corner]].concat();
            [head, mesh].concat()
        };
        assert_eq!(scene.take(&block(7, 2)), Ok(()));
        assert_eq!(scene.take(&block(8, 2)), Err(Malformed::Dangling));
        assert_eq!(scene.take(&block(7, 3)), Err(Malformed::Dangling));
        assert_eq!(scene.take(&[block(7, 2), vec![0]].concat()), Err(Malformed::Long(1)));
    }
}
