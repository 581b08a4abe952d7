use super::*;
use cairn_dense::{BlockKey, Mesh};
use cairn_geometry::{Se3, So3, Vec3};
use std::time::Duration;

const VOXEL_M: f32 = 0.02;

/// Positions of a block's vertices, and the corners of its triangles.
type Block = (Vec<[u16; 3]>, Vec<[u16; 3]>);

/// A page: what it draws, by the messages.
#[derive(Default)]
struct Page {
    poses: BTreeMap<u32, Pose>,
    blocks: BTreeMap<Name, Block>,
}

struct Reader<'a>(&'a [u8]);

impl Reader<'_> {
    fn bytes<const N: usize>(&mut self) -> [u8; N] {
        let (head, rest) = self.0.split_at(N);
        self.0 = rest;
        head.try_into().unwrap()
    }
    fn number(&mut self) -> u32 {
        u32::from_le_bytes(self.bytes())
    }
    fn short(&mut self) -> u16 {
        u16::from_le_bytes(self.bytes())
    }
}

impl Page {
    /// Takes a message; returns the blocks in it.
    fn take(&mut self, message: &[u8]) -> Vec<Name> {
        let mut r = Reader(message);
        let [kind, whole, ..] = r.bytes::<4>();
        assert_eq!(kind, KIND);
        assert_eq!(whole == 1, self.poses.is_empty() && self.blocks.is_empty());
        assert_eq!(f32::from_le_bytes(r.bytes()), VOXEL_M);
        for _ in 0..r.number() {
            let id = r.number();
            assert!(self.poses.remove(&id).is_some());
            self.blocks.retain(|(of, _), _| *of != id);
        }
        for _ in 0..r.number() {
            self.poses.insert(r.number(), [(); 12].map(|()| f32::from_le_bytes(r.bytes())));
        }
        let mut names = Vec::new();
        for _ in 0..r.number() {
            let name = (r.number(), [(); 3].map(|()| i32::from_le_bytes(r.bytes())));
            assert!(self.poses.contains_key(&name.0), "a block without a place");
            r.number();
            let (vertices, triangles) = (r.short(), r.short());
            let positions = (0..vertices).map(|_| [(); 3].map(|()| r.short())).collect();
            let mut corner = || if vertices <= 256 { r.bytes::<1>()[0].into() } else { r.short() };
            let corners = (0..triangles).map(|_| [(); 3].map(|()| corner())).collect();
            match triangles {
                0 => drop(self.blocks.remove(&name)),
                _ => drop(self.blocks.insert(name, (positions, corners))),
            }
            names.push(name);
        }
        assert!(r.0.is_empty(), "{} bytes are left", r.0.len());
        names
    }

    fn assert_shows(&self, surface: &Surface) {
        let poses: BTreeMap<u32, Pose> = surface.parts.iter().map(|(id, part)| (*id, part.pose)).collect();
        assert_eq!(self.poses, poses);
        let all = surface.parts.iter().flat_map(|(id, part)| {
            part.pieces.iter().map(|(key, p)| ((*id, *key), (p.positions.clone(), p.triangles.clone())))
        });
        assert_eq!(self.blocks, all.collect());
    }
}

/// A mesh of `n` vertices in a block, in a column `high` units of the grid above its corner.
fn mesh(key: [i32; 3], n: usize, high: f32) -> Mesh {
    let corner = key.map(|k| k as f32 * 8.0 * VOXEL_M);
    let at = |i: usize| [1.0 + 0.01 * (i % 500) as f32, 2.0 + (i % 3) as f32, 1.0 + high];
    let place = |i: usize| std::array::from_fn(|k| corner[k] + VOXEL_M * at(i)[k]);
    Mesh {
        positions: (0..n).map(place).collect(),
        triangles: (2..n as u32).map(|i| [i - 2, i - 1, i]).collect(),
        ..Mesh::default()
    }
}

/// The `k`th block of a wall of 48 metres.
fn key(k: i32) -> BlockKey {
    BlockKey([k % 300, 0, k / 300])
}

/// A wall of `n` blocks.
fn wall(n: i32) -> Surface {
    let mut surface = Surface::default();
    surface.voxels(VOXEL_M);
    surface.place(0, &Se3::identity());
    (0..n).for_each(|k| surface.set(0, key(k), &mesh(key(k).0, 100, 0.0), 7));
    surface
}

fn shifted(by: f64) -> Se3 {
    Se3::new(So3::exp(&Vec3::new(0.0, 0.1, 0.0)), Vec3::new(by, 0.0, 0.0))
}

/// Sends until nothing is left; returns how many bytes and the names in their order.
fn send_all(sent: &mut Sent, page: &mut Page, surface: &Surface, now: &mut Instant) -> (usize, Vec<Name>) {
    let (mut bytes, mut names) = (0, Vec::new());
    for _ in 0..400 {
        *now += Duration::from_millis(125);
        if let Some(message) = sent.message(surface, usize::MAX, *now) {
            bytes += message.len();
            names.extend(page.take(&message));
        }
    }
    (bytes, names)
}

#[test]
fn page_that_takes_the_messages_has_the_surface() {
    let mut now = Instant::now();
    let (mut surface, mut sent, mut page) = (wall(300), Sent::new(now), Page::default());
    // Another submap, with a block whose corners need 16 bits, and one below zero.
    surface.place(4, &shifted(1.0));
    surface.set(4, BlockKey([0, 0, 0]), &mesh([0, 0, 0], 700, 0.0), 9);
    surface.set(4, BlockKey([-3, -1, -70_000]), &mesh([-3, -1, -70_000], 5, 0.0), 9);
    send_all(&mut sent, &mut page, &surface, &mut now);
    page.assert_shows(&surface);
    assert_eq!(sent.message(&surface, usize::MAX, now), None, "nothing has changed");
    // A correction of the map moves poses and sends no vertex.
    surface.place(4, &shifted(1.5));
    now += Duration::from_secs(1);
    let message = sent.message(&surface, usize::MAX, now).unwrap();
    assert!(message.len() == HEAD + POSE && page.take(&message).is_empty());
    page.assert_shows(&surface);
    // Blocks and submaps go, also those that the page never had.
    surface.set(0, BlockKey([3, 0, 0]), &Mesh::default(), 9);
    surface.set(0, BlockKey([900, 0, 0]), &mesh([900, 0, 0], 9, 0.0), 9);
    surface.set(0, BlockKey([900, 0, 0]), &Mesh::default(), 9);
    surface.keep(|id| id == 0);
    let (_, names) = send_all(&mut sent, &mut page, &surface, &mut now);
    assert_eq!(names, [(0, [3, 0, 0])]);
    page.assert_shows(&surface);
    // It comes back, and a page that comes later gets all of it.
    surface.set(0, BlockKey([3, 0, 0]), &mesh([3, 0, 0], 9, 0.0), 9);
    surface.place(5, &Se3::identity());
    send_all(&mut sent, &mut page, &surface, &mut now);
    page.assert_shows(&surface);
    let (mut late, mut other) = (Sent::new(now), Page::default());
    send_all(&mut late, &mut other, &surface, &mut now);
    other.assert_shows(&surface);
    surface.keep(|_| false);
    send_all(&mut sent, &mut page, &surface, &mut now);
    page.assert_shows(&surface);
}

#[test]
fn vertices_are_where_the_mesh_has_them_and_neighbours_meet() {
    let key = [-7, 3, 12];
    let made = mesh(key, 300, 0.37);
    let piece = Piece::of(&made, BlockKey(key), VOXEL_M).unwrap();
    for (p, q) in made.positions.iter().zip(&piece.positions) {
        for i in 0..3 {
            let back = VOXEL_M * (8.0 * key[i] as f32 + f32::from(q[i]) / 4096.0);
            assert!((back - p[i]).abs() < VOXEL_M / 4096.0, "{back} {}", p[i]);
        }
    }
    // The same vertex, half a voxel behind the border, in both blocks.
    let on = Mesh {
        positions: vec![[8.5 * VOXEL_M, 0.03, 0.03], [0.13, 0.05, 0.03], [0.13, 0.03, 0.05]],
        triangles: vec![[0, 1, 2]],
        ..Mesh::default()
    };
    let here = Piece::of(&on, BlockKey([0, 0, 0]), VOXEL_M).unwrap().positions[0][0];
    let apart = Mesh { positions: vec![[8.5 * VOXEL_M, 0.03, 0.03]; 3], ..on.clone() };
    let there = Piece::of(&apart, BlockKey([1, 0, 0]), VOXEL_M).unwrap().positions[0][0];
    assert_eq!(here - 8 * 4096, there);
    // Of another block, or not finite: left out.
    assert!(Piece::of(&on, BlockKey([5, 0, 0]), VOXEL_M).is_none());
    let nan = Mesh { positions: vec![[f32::NAN; 3]; 3], ..on };
    assert!(Piece::of(&nan, BlockKey([0, 0, 0]), VOXEL_M).is_none());
}

#[test]
fn what_noise_moves_is_not_sent_again_and_does_not_add_up() {
    let mut now = Instant::now();
    let (mut surface, mut sent, mut page) = (wall(1), Sent::new(now), Page::default());
    send_all(&mut sent, &mut page, &surface, &mut now);
    let mut times = 0;
    for k in 1..=20 {
        surface.set(0, BlockKey([0, 0, 0]), &mesh([0, 0, 0], 100, 0.1 * k as f32), 8);
        times += send_all(&mut sent, &mut page, &surface, &mut now).1.len();
        let height = f32::from(page.blocks[&(0, [0, 0, 0])].0[0][2]) / 4096.0;
        assert!((height - 1.0 - 0.1 * k as f32).abs() <= 0.26, "{height} after {k}");
    }
    assert_eq!(times, 6, "two voxels in steps of at least a quarter");
}

#[test]
fn no_second_has_more_than_200_kb_and_nothing_is_left_out() {
    let mut now = Instant::now();
    let began = now;
    let (mut surface, mut sent, mut page) = (wall(2000), Sent::new(now), Page::default());
    let mut log: Vec<(f64, usize)> = Vec::new();
    let mut last = None;
    // The 250 blocks beside the camera change all the time: 260 kB/s, more than may be sent.
    for tick in 0..800 {
        now += Duration::from_millis(125);
        if tick % 8 == 0 {
            let high = 1.0 + (tick / 8 % 4) as f32;
            (0..250).for_each(|k| surface.set(0, key(k), &mesh(key(k).0, 100, high), 9));
        }
        if let Some(message) = sent.message(&surface, usize::MAX, now) {
            log.push((now.duration_since(began).as_secs_f64(), message.len()));
            page.take(&message);
        }
        if page.blocks.len() == 2000 {
            last.get_or_insert(tick);
        }
    }
    let most =
        |at: f64| log.iter().filter(|(t, _)| (at..at + 1.0).contains(t)).map(|(_, n)| n).sum::<usize>();
    let most = log.iter().map(|(t, _)| most(*t)).max().unwrap();
    assert!((150_000..=200_000).contains(&most), "{most} bytes in a second");
    let last = f64::from(last.expect("a block was never sent")) / 8.0;
    assert!(last < 60.0, "all 2,000 blocks after {last} s");
    // Once it is quiet, the page has the newest of everything.
    send_all(&mut sent, &mut page, &surface, &mut now);
    page.assert_shows(&surface);
}

#[test]
fn nearest_is_first_and_a_slow_link_gets_small_messages() {
    let mut now = Instant::now();
    let (mut surface, mut sent, mut page) = (wall(100), Sent::new(now), Page::default());
    surface.camera_at([50.5 * 0.16, 0.0, 0.0]);
    // A block too large for this link keeps no other from being sent.
    surface.set(0, BlockKey([50, 0, 0]), &mesh([50, 0, 0], 800, 0.0), 9);
    let mut names = Vec::new();
    for _ in 0..200 {
        now += Duration::from_millis(125);
        let Some(message) = sent.message(&surface, 4096, now) else { continue };
        assert!(message.len() <= 4096);
        names.extend(page.take(&message).into_iter().map(|(_, key)| key[0]));
    }
    assert_eq!(names.len(), 99);
    assert!(names.windows(2).all(|w| (w[0] - 50).abs() <= (w[1] - 50).abs()), "{names:?}");
    assert!(sent.message(&surface, 40_000, now).is_some_and(|m| page.take(&m) == [(0, [50, 0, 0])]));
    page.assert_shows(&surface);
}
