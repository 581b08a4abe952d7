//! Surfaces as files: the form follows from the ending; a picture of one as PNG.

use crate::failure::Failure;
use cairn_dense::{Mesh, TsdfConfig, overview, write_glb, write_heights, write_obj, write_ply};
use cairn_engine::DenseMapper;
use cairn_geometry::Vec3;
use std::path::Path;

/// Width and height of a picture, pixels.
const PICTURE: [usize; 2] = [1280, 860];

/// How a mesh becomes the bytes of a file; `up` is the direction that glTF turns upwards.
pub type Write = fn(&Mesh, up: [f64; 3], &mut Vec<u8>) -> std::io::Result<()>;

/// The form that the ending of a file asks for.
///
/// # Errors
/// An ending that names no form.
pub fn form(path: &Path) -> Result<Write, Failure> {
    let ending = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
    Ok(match ending.as_deref() {
        Some("ply") => |mesh, _, to| write_ply(mesh, to),
        Some("obj") => |mesh, _, to| write_obj(mesh, to),
        Some("pgm") => |mesh, up, to| write_heights(mesh, up, to),
        Some("glb") => |mesh, up, to| write_glb(mesh, up, to),
        _ => {
            return Err(Failure::new(
                path.display().to_string(),
                "has no ending that names a form",
                "end it in .ply, .glb or .obj, or in .pgm for a heightmap",
            ));
        }
    })
}

/// A surface with what points up in its frame.
pub struct Surface {
    pub mesh: Mesh,
    pub up: Vec3,
}

impl Surface {
    /// The surface of the largest map, with the poses that its key frames have now.
    ///
    /// # Errors
    /// When there is no map, or its poses cannot be used.
    pub fn of(mapper: &mut DenseMapper, gravity_aligned: bool) -> Result<Self, Failure> {
        mapper.follow();
        let fail = |why: String| Failure::new("the surface", why, "look at the report of the run");
        let map = mapper.largest_map().ok_or_else(|| fail("there is no map".into()))?;
        let tsdf = TsdfConfig { colour: true, ..TsdfConfig::default() };
        let mesh = mapper.surface(map, tsdf).map_err(|e| fail(e.to_string()))?;
        if mesh.positions.is_empty() {
            return Err(fail("no key frame had usable depth".into()));
        }
        // A map without gravity begins with y down.
        Ok(Self { mesh, up: if gravity_aligned { Vec3::z() } else { -Vec3::y() } })
    }

    /// The bytes of a file.
    ///
    /// # Errors
    /// A mesh that is too large for the form.
    pub fn bytes(&self, write: Write, name: &str) -> Result<Vec<u8>, Failure> {
        let mut bytes = Vec::new();
        let up = [self.up.x, self.up.y, self.up.z];
        write(&self.mesh, up, &mut bytes)
            .map_err(|e| Failure::new(name, e.to_string(), "use a larger --voxel or another form"))?;
        Ok(bytes)
    }

    /// A picture of it from above, as PNG.
    ///
    /// # Errors
    /// When it cannot be drawn.
    pub fn picture(&self) -> Result<Vec<u8>, Failure> {
        let fail = |why: String| {
            Failure::new("the picture of the surface", why, "report this with the command line")
        };
        let [width, height] = PICTURE;
        let image = overview(&self.mesh, &self.up, width, height).map_err(|e| fail(e.to_string()))?;
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, width as u32, height as u32);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        let mut writer = encoder.write_header().map_err(|e| fail(e.to_string()))?;
        writer.write_image_data(image.data().as_flattened()).map_err(|e| fail(e.to_string()))?;
        writer.finish().map_err(|e| fail(e.to_string()))?;
        Ok(bytes)
    }
}
