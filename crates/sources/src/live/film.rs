//! The pictures of a video file by their numbers, through the `ffmpeg` program: of a recording whose times are elsewhere.

use super::address::Address;
use super::child::{ChildCommand, Feed, Handle};
use cairn_sensor::{GrayImage, SourceError};
use std::path::Path;

/// A film that is read forward.
pub struct Film {
    handle: Handle,
    feed: Option<Feed>,
    size: [usize; 2],
    next: usize,
}

impl Film {
    /// Opens a file. Its pictures are as the camera gave them: a calibration beside it is that of the sensor, whichever way up the
    /// file is to be shown.
    ///
    /// # Errors
    /// When `ffmpeg` is not installed, or the file is no video.
    pub fn open(path: &Path) -> Result<Self, SourceError> {
        let shown = path.display().to_string();
        let address = Address::of(&shown).unwrap_or_else(|| {
            Err(SourceError::new(&shown, "is no video file", "give the recording's own film"))
        })?;
        let address = Address { before: vec!["-noautorotate".into()], ..address };
        Self::started(&ChildCommand::ffmpeg(&address, &[]), &shown)
    }

    fn started(command: &ChildCommand, shown: &str) -> Result<Self, SourceError> {
        let handle = Handle::default();
        let mut feed = Feed::start(command, &handle)?;
        match feed.header() {
            Some((size, _)) => Ok(Self { handle, feed: Some(feed), size, next: 0 }),
            None => Err(SourceError::new(shown, feed.end(), "give a file with a video track")),
        }
    }

    /// Width and height.
    pub fn size(&self) -> [usize; 2] {
        self.size
    }

    /// The picture with this number, from 0; `None` beyond the end, and of those before one that was given already.
    pub fn image(&mut self, number: usize) -> Option<GrayImage> {
        if number < self.next {
            return None;
        }
        let feed = self.feed.as_mut()?;
        loop {
            let (image, _) = feed.next_image(self.size)?;
            self.next += 1;
            if self.next > number {
                return Some(image);
            }
        }
    }
}

impl Drop for Film {
    fn drop(&mut self) {
        self.handle.end();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_of_a_film_are_taken_by_their_numbers() {
        let script = r#"
            echo 'YUV4MPEG2 W16 H16 F25:1 Cmono'
            for value in a b c d; do
                echo "[Parsed_showinfo_1 @ 0x5] n: 0 pts: 1 pts_time:1 x" >&2
                echo FRAME; head -c 256 /dev/zero | tr '\0' $value
            done"#;
        let mut film = Film::started(&ChildCommand::shell(script), "film").unwrap();
        assert_eq!(film.size(), [16, 16]);
        let mut first = |number| film.image(number).map(|image| image.data()[0]);
        assert_eq!([0, 2, 1, 3, 4].map(&mut first), [Some(b'a'), Some(b'c'), None, Some(b'd'), None]);
    }
}
