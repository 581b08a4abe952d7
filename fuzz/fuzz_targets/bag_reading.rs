//! What the targets of bags share: the input is a file of one kind, opened, every message read and decoded.

use cairn_bag::{Bag, CameraInfo, CompressedImage, ImageMessage, ImuMessage, static_transforms};
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

/// In memory where the system has such a folder: it is written for every input.
static FILE: LazyLock<PathBuf> = LazyLock::new(|| {
    let memory = Path::new("/dev/shm");
    let root = if memory.is_dir() { memory.to_owned() } else { std::env::temp_dir() };
    root.join(format!("cairn-fuzz-bag-{}", std::process::id()))
});

/// Opens the bytes behind the magic of their kind. What is indexed lies within the file or in a chunk of it; whatever can be
/// read is decoded or refused.
pub fn check(magic: &[u8], bytes: &[u8]) {
    let file = [magic, bytes.get(magic.len()..).unwrap_or_default()].concat();
    std::fs::write(&*FILE, file).expect("a file");
    let Ok(mut bag) = Bag::open(&FILE, &|_, _| 1000) else { return };
    for topic in bag.topics().to_vec() {
        assert!(topic.entries.len() <= topic.count.min(1000));
        assert!(topic.entries.windows(2).all(|w| w[0].log_ns <= w[1].log_ns));
        for entry in &topic.entries {
            let Ok(bytes) = bag.read(entry) else { continue };
            if let Ok(image) = ImageMessage::of(&topic.kind, topic.format, &bytes) {
                let size = image.width as usize * image.height as usize;
                image.gray().iter().for_each(|g| assert_eq!(g.data().len(), size));
                image.depth().iter().for_each(|d| assert_eq!(d.data().len(), size));
            }
            let _ = CompressedImage::of(&topic.kind, topic.format, &bytes).map(|c| c.file().map(<[u8]>::len));
            let _ = ImuMessage::decode(topic.format, &bytes);
            if let Ok(info) = CameraInfo::of(&topic.kind, topic.format, &bytes) {
                for rectified in [false, true] {
                    info.camera(rectified).iter().for_each(|c| assert_eq!(c.validate(), Ok(())));
                }
            }
            for t in static_transforms(topic.format, &bytes).unwrap_or_default() {
                assert!(t.parent_from_child.is_finite());
            }
        }
    }
}
