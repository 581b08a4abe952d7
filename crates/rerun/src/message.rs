//! What can be shown: each [`Message`] sets the time, or what an entity shows from then on.
//!
//! Entities have names like paths (`map0/cam0/image`); the pose of one holds for those below it. Numbers are in single
//! precision, as rerun keeps them: about 0.1 mm at 1 km from the origin of the map.

use serde::{Deserialize, Serialize};

/// One message.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Message {
    /// The first message: the name of the recording, as the viewer shows it.
    Begin {
        /// The name.
        name: String,
    },
    /// The time of what follows.
    At {
        /// The source's stamp in nanoseconds.
        stamp_ns: i64,
        /// The number of the frame.
        frame: i64,
    },
    /// What an entity shows from now on, instead of what it showed before.
    Show {
        /// The name of the entity.
        entity: String,
        /// What it shows.
        what: Show,
    },
    /// The last message: the recording is complete.
    End,
}

/// What an entity shows.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Show {
    /// Which way is up: z, as in a gravity-aligned map, or the axes of a camera (x right, y down, z ahead).
    Axes {
        /// Whether z points up.
        z_is_up: bool,
    },
    /// The pinhole part of a camera, for the whole recording: rerun knows no distortion, and shows images as they were taken.
    Lens {
        /// Width and height in pixels.
        size: [u32; 2],
        /// Focal lengths in pixels.
        focal: [f32; 2],
        /// Principal point in pixels; pixel centres are at integer coordinates.
        centre: [f32; 2],
    },
    /// The pose in the frame of the entity above it.
    Pose(Pose),
    /// A gray image.
    Image {
        /// Width and height in pixels.
        size: [u32; 2],
        /// The rows, one after the other.
        gray: Vec<u8>,
    },
    /// Marked pixels of the image above it; pixel centres are at integer coordinates.
    Pixels(Vec<[f32; 2]>, Colour),
    /// Points.
    Points(Vec<[f32; 3]>, Colour),
    /// Lines, each through its points.
    Lines(Vec<Vec<[f32; 3]>>, Colour),
    /// Boxes parallel to the axes, each by its lowest and its highest corner.
    Boxes(Vec<[[f32; 3]; 2]>, Colour),
    /// A text.
    Text(Level, String),
    /// A number, which the viewer plots over time.
    Number(f64),
}

/// A rotation, then a translation, of what was scaled: `parent_from_entity`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Pose {
    /// The translation.
    pub translation: [f32; 3],
    /// The rotation as a unit quaternion, real part last.
    pub xyzw: [f32; 4],
    /// Lengths in the parent for each length in the entity.
    pub scale: f32,
}

/// How important a text is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Level {
    /// What happens in good order.
    Info,
    /// What the reader should look at.
    Warning,
}

/// A colour: red, green, blue.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Colour(pub u8, pub u8, pub u8);

impl Colour {
    /// Light grey.
    pub const GREY: Self = Self(190, 190, 190);
    /// Blue.
    pub const BLUE: Self = Self(80, 140, 255);
    /// Green.
    pub const GREEN: Self = Self(60, 200, 90);
    /// Orange.
    pub const ORANGE: Self = Self(255, 150, 30);
    /// Red.
    pub const RED: Self = Self(240, 60, 60);
}
