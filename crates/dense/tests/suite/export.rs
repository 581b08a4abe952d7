//! Written files are read back byte by byte, as their formats specify.

use cairn_dense::{Mesh, write_glb, write_obj, write_ply};

fn mesh(colours: bool) -> Mesh {
    Mesh {
        positions: vec![[0.0, 0.5, -1.25], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 3.5]],
        normals: vec![[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]],
        colours: if colours { vec![[255, 0, 1], [2, 3, 4], [5, 6, 7], [8, 9, 10]] } else { Vec::new() },
        triangles: vec![[0, 1, 2], [3, 2, 1]],
    }
}

fn written(write: impl FnOnce(&mut Vec<u8>) -> std::io::Result<()>) -> Vec<u8> {
    let mut out = Vec::new();
    write(&mut out).expect("memory takes all");
    out
}

/// Header text and what follows it.
fn split<'a>(bytes: &'a [u8], end: &str) -> (String, &'a [u8]) {
    let at = bytes.windows(end.len()).position(|w| w == end.as_bytes()).expect("a header") + end.len();
    (String::from_utf8(bytes[..at].to_vec()).expect("text"), &bytes[at..])
}

fn f32_at(bytes: &[u8], at: usize) -> f32 {
    f32::from_le_bytes(bytes[at..at + 4].try_into().expect("four bytes"))
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(bytes[at..at + 4].try_into().expect("four bytes"))
}

#[test]
fn ply_holds_vertices_normals_colours_and_faces() {
    for colours in [false, true] {
        let mesh = mesh(colours);
        let bytes = written(|out| write_ply(&mesh, out));
        let (header, body) = split(&bytes, "end_header\n");
        assert!(header.starts_with("ply\nformat binary_little_endian 1.0\n"));
        assert!(header.contains("element vertex 4\n") && header.contains("element face 2\n"));
        assert_eq!(header.contains("property uchar red\n"), colours);
        let size = if colours { 27 } else { 24 };
        assert_eq!(body.len(), 4 * size + 2 * 13);
        for (i, p) in mesh.positions.iter().enumerate() {
            assert_eq!([0, 4, 8].map(|k| f32_at(body, i * size + k)), *p);
            assert_eq!([12, 16, 20].map(|k| f32_at(body, i * size + k)), mesh.normals[i]);
        }
        assert_eq!(body[4 * size], 3);
        assert_eq!([1, 5, 9].map(|k| u32_at(body, 4 * size + 13 + k)), mesh.triangles[1]);
    }
}

#[test]
fn glb_is_two_chunks_whose_views_fit() {
    for colours in [false, true] {
        let bytes = written(|out| write_glb(&mesh(colours), [0.0, -1.0, 0.0], out));
        assert_eq!(&bytes[..4], b"glTF");
        assert_eq!([u32_at(&bytes, 4), u32_at(&bytes, 8)], [2, bytes.len() as u32]);
        let json_length = u32_at(&bytes, 12) as usize;
        assert_eq!(&bytes[16..20], b"JSON");
        let json = std::str::from_utf8(&bytes[20..20 + json_length]).expect("text");
        let opened = json.matches(['{', '[']).count();
        assert_eq!(opened, json.matches(['}', ']']).count());
        let binary = 20 + json_length;
        assert_eq!(json_length % 4, 0);
        assert_eq!(&bytes[binary + 4..binary + 8], b"BIN\0");
        let length = 96 + if colours { 16 } else { 0 } + 24;
        assert_eq!(u32_at(&bytes, binary) as usize, length);
        assert_eq!(bytes.len(), binary + 8 + length);
        assert!(json.contains("\"min\":[0.0, 0.0, -1.25],\"max\":[1.0, 1.0, 3.5]"), "{json}");
        assert_eq!(json.contains("COLOR_0"), colours);
        assert_eq!(f32_at(&bytes, binary + 8 + 8), -1.25);
        assert_eq!(u32_at(&bytes, bytes.len() - 4), 1, "the last index");
    }
    let empty = written(|out| write_glb(&Mesh::default(), [0.0, 0.0, 1.0], out));
    assert_eq!(u32_at(&empty, 8) as usize, empty.len());
}

#[test]
fn obj_says_what_it_holds() {
    let text = String::from_utf8(written(|out| write_obj(&mesh(true), out))).expect("text");
    assert!(text.contains("\nv 0 0.5 -1.25 1.0000 0.0000 0.0039\n"));
    assert!(text.contains("\nvn 0.0000 0.0000 1.0000\n") && text.ends_with("f 4//4 3//3 2//2\n"));
}
