//! Binary glTF 2.0 (Khronos, "glTF 2.0 specification", sections 4 and 5): one mesh, one file.

use crate::Mesh;
use std::io::{self, Write};

/// Writes a mesh. glTF has y up; coordinates are written unchanged, and the node's rotation turns `up` to +y.
///
/// # Errors
/// I/O errors of the writer; a mesh too large for the format (4 GiB).
pub fn write_glb(mesh: &Mesh, up: [f64; 3], out: &mut impl Write) -> io::Result<()> {
    let mut binary = Binary::default();
    let position = binary.add(mesh.positions.iter().flatten().flat_map(|v| v.to_le_bytes()), 34962);
    let normal = binary.add(mesh.normals.iter().flatten().flat_map(|v| v.to_le_bytes()), 34962);
    let has_colours = !mesh.colours.is_empty();
    // glTF vertex colours are linear, camera colours are sRGB.
    let linear = |c: u8| ((f64::from(c) / 255.0).powf(2.2) * 255.0 + 0.5) as u8;
    let colour = has_colours.then(|| {
        binary.add(mesh.colours.iter().flat_map(|c| [linear(c[0]), linear(c[1]), linear(c[2]), 255]), 34962)
    });
    let index = binary.add(mesh.triangles.iter().flatten().flat_map(|i| i.to_le_bytes()), 34963);
    let json = document(mesh, &binary, up, [position, normal, index], colour);
    let padded = json.len().next_multiple_of(4);
    let total = 12 + 8 + padded + 8 + binary.bytes.len();
    let length = |n: usize| {
        u32::try_from(n).map(u32::to_le_bytes).map_err(|_| io::Error::other("the mesh is too large for glTF"))
    };
    let total = length(total)?;
    out.write_all(b"glTF")?;
    out.write_all(&2u32.to_le_bytes())?;
    out.write_all(&total)?;
    out.write_all(&length(padded)?)?;
    out.write_all(b"JSON")?;
    out.write_all(json.as_bytes())?;
    out.write_all(&vec![b' '; padded - json.len()])?;
    out.write_all(&length(binary.bytes.len())?)?;
    out.write_all(b"BIN\0")?;
    out.write_all(&binary.bytes)
}

/// Buffer views in file order.
#[derive(Default)]
struct Binary {
    bytes: Vec<u8>,
    views: Vec<String>,
}

impl Binary {
    /// Adds a buffer view, padded to a multiple of four bytes; returns its index.
    fn add(&mut self, bytes: impl Iterator<Item = u8>, target: u32) -> usize {
        let from = self.bytes.len();
        self.bytes.extend(bytes);
        let length = self.bytes.len() - from;
        self.views.push(format!(
            "{{\"buffer\":0,\"byteOffset\":{from},\"byteLength\":{length},\"target\":{target}}}"
        ));
        self.views.len() - 1
    }
}

fn document(mesh: &Mesh, binary: &Binary, up: [f64; 3], views: [usize; 3], colour: Option<usize>) -> String {
    let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for p in &mesh.positions {
        (0..3).for_each(|i| (low[i], high[i]) = (low[i].min(p[i]), high[i].max(p[i])));
    }
    if mesh.positions.is_empty() {
        (low, high) = ([0.0; 3], [0.0; 3]);
    }
    let (n, m) = (mesh.positions.len(), 3 * mesh.triangles.len());
    let [position, normal, index] = views;
    let mut accessors = vec![
        format!(
            "{{\"bufferView\":{position},\"componentType\":5126,\"count\":{n},\"type\":\"VEC3\",\"min\":{low:?},\"max\":{high:?}}}"
        ),
        format!("{{\"bufferView\":{normal},\"componentType\":5126,\"count\":{n},\"type\":\"VEC3\"}}"),
        format!("{{\"bufferView\":{index},\"componentType\":5125,\"count\":{m},\"type\":\"SCALAR\"}}"),
    ];
    let mut attributes = "\"POSITION\":0,\"NORMAL\":1".to_owned();
    if let Some(view) = colour {
        accessors.push(format!(
            "{{\"bufferView\":{view},\"componentType\":5121,\"normalized\":true,\"count\":{n},\"type\":\"VEC4\"}}"
        ));
        attributes.push_str(",\"COLOR_0\":3");
    }
    let rotation = turn_to_y(up);
    // A mesh without triangles has no primitive: the format forbids empty accessors.
    let content = if n == 0 || m == 0 {
        "\"nodes\":[{}]".to_owned()
    } else {
        format!(
            "\"nodes\":[{{\"mesh\":0,\"rotation\":{rotation:?}}}],\
             \"meshes\":[{{\"primitives\":[{{\"attributes\":{{{attributes}}},\"indices\":2,\"material\":0}}]}}],\
             \"materials\":[{{\"doubleSided\":true,\"pbrMetallicRoughness\":{{\"metallicFactor\":0,\"roughnessFactor\":1}}}}],\
             \"accessors\":[{}],\"bufferViews\":[{}],\"buffers\":[{{\"byteLength\":{}}}]",
            accessors.join(","),
            binary.views.join(","),
            binary.bytes.len()
        )
    };
    format!(
        "{{\"asset\":{{\"version\":\"2.0\",\"generator\":\"cairn\"}},\"scene\":0,\"scenes\":[{{\"nodes\":[0]}}],{content}}}"
    )
}

/// The shortest rotation that turns a direction to +y, as x, y, z, w.
fn turn_to_y(up: [f64; 3]) -> [f64; 4] {
    let up = nalgebra::Vector3::from(up);
    let to = nalgebra::Vector3::y();
    let turn = nalgebra::UnitQuaternion::rotation_between(&up, &to).unwrap_or_else(|| {
        nalgebra::UnitQuaternion::from_axis_angle(&nalgebra::Vector3::x_axis(), std::f64::consts::PI)
    });
    [turn.i, turn.j, turn.k, turn.w]
}
