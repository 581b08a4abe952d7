//! After any history, submaps equal their frames fused afresh with the final poses.

use super::*;
use crate::{MeshConfig, Mesher};
use cairn_geometry::{So3, Vec3};
use proptest::prelude::*;
use std::collections::BTreeMap;

#[path = "../../tests/suite/wall/mod.rs"]
mod wall;
use wall::{camera, config, pose, wall};

fn voxels(volume: &TsdfVolume) -> BTreeMap<[i32; 3], (f64, i32)> {
    let of = |key: crate::BlockKey| {
        (0..512).filter_map(move |i: i32| {
            let voxel = [key.0[0] * 8 + (i & 7), key.0[1] * 8 + (i >> 3 & 7), key.0[2] * 8 + (i >> 6)];
            volume.voxel(voxel).map(|v| (voxel, v))
        })
    };
    volume.changed_since(0).flat_map(of).collect()
}

/// What the camera of [`wall`] sees: shades that differ from place to place.
fn stripes(x: f64) -> GrayImage {
    let at = |i: usize| (60.0 + 40.0 * (x + (i % 80) as f64 / 30.0).sin() + (i / 80) as f64) as u8;
    GrayImage::from_vec(80, 60, (0..80 * 60).map(at).collect()).expect("all pixels")
}

fn finish(map: &mut DenseMap) {
    for _ in 0..10_000 {
        if map.step(&Vec3::zeros(), 7).waiting == 0 {
            return;
        }
    }
    panic!("the work does not end");
}

/// The odds of all voxels that the images of the tests reach.
fn odds(grid: &OccupancyGrid) -> Vec<i8> {
    let side = || -40..60;
    let all = side().flat_map(|z| (-25..25).flat_map(move |y| side().map(move |x| [x, y, z])));
    all.map(|v| grid.odds(v)).collect()
}

/// Checks that each submap is bit by bit its frames fused afresh with poses that are within a centimetre of the final
/// ones; returns the number of submaps.
fn check(map: &mut DenseMap) -> usize {
    let mut count = 0;
    for index in 0..map.submaps.len() {
        let Some((_, world_from_submap)) = map.place(index) else { continue };
        count += 1;
        let mut field = TsdfVolume::new(map.config.tsdf).expect("in range");
        let mut grid = OccupancyGrid::new(map.config.occupancy).expect("in range");
        for (kept, fused) in map.kept.iter().filter_map(|k| Some((k, *k.inside(index)?))) {
            let frame = map.preparer.prepare(&kept.depth.unpack().expect("whole")).expect("depth").clone();
            let wanted = world_from_submap.inverse()
                * map.anchors[&kept.anchored.anchor].world_from_anchor
                * kept.anchored.pose;
            field.integrate(&frame, None, &fused).expect("a pose");
            grid.integrate(&frame, &fused).expect("a pose");
            let off = fused.inverse() * wanted;
            assert!(off.translation.norm() + 2.0 * off.rotation.log().norm() <= map.config.moved_m + 1e-9);
        }
        let submap = map.submaps[index].as_ref().expect("a place");
        let whole = submap.field.whole().expect("all are wanted");
        assert_eq!(voxels(whole), voxels(&field));
        assert!(field.changed_since(0).all(|key| submap.field.has(key)));
        assert!(odds(&submap.occupancy) == odds(&grid), "occupancy of submap {index}");
        assert!(!submap.stale);
    }
    count
}

#[derive(Clone, Debug)]
enum Event {
    Insert { map: u64, x: f64 },
    Align(Vec<[f64; 3]>),
    Merge([f64; 3]),
    Remove(usize),
    Forget(u64),
    Step(usize),
    WantAll(bool),
}

fn event() -> impl Strategy<Value = Event> {
    let small = || [-0.04f64..0.04, -0.04f64..0.04, -0.05f64..0.05];
    prop_oneof![
        4 => (0u64..2, -1.0f64..3.0).prop_map(|(map, x)| Event::Insert { map, x }),
        2 => proptest::collection::vec(small(), 1..6).prop_map(Event::Align),
        1 => small().prop_map(Event::Merge),
        1 => (0usize..20).prop_map(Event::Remove),
        1 => (0u64..12).prop_map(Event::Forget),
        2 => (1usize..6).prop_map(Event::Step),
        1 => any::<bool>().prop_map(Event::WantAll),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, ..ProptestConfig::default() })]

    #[test]
    fn any_history_ends_as_if_fused_afresh(events in proptest::collection::vec(event(), 6..24), tight: bool) {
        let config = config();
        // With no room for fields all are released but the one in use.
        let config = SubmapConfig { most_bytes: if tight { 0 } else { config.most_bytes }, ..config };
        let mut map = DenseMap::new(config, camera(), 0.001).expect("a camera");
        let (mut next, mut forgotten) = (0, 0);
        for event in events {
            match event {
                Event::Insert { map: id, x } => {
                    // After a merge there is one map left.
                    let id = if map.anchors.values().any(|a| a.map == MapId(id)) || id == 0 { id } else { 1 };
                    // Some come without a picture, as those of an older map.
                    let gray = (next % 3 > 0).then(|| stripes(x));
                    map.insert(AnchorId(next), MapId(id), pose(x, [0.0; 3]), Se3::identity(), &wall(x), gray.as_ref())
                        .expect("depth");
                    next += 1;
                }
                Event::Align(by) => {
                    let moved: Vec<_> = map.anchors.iter().zip(by.iter().cycle())
                        .map(|((id, a), w)| (*id, a.world_from_anchor * pose(w[2], *w))).collect();
                    map.align(&moved).expect("finite");
                }
                Event::Merge(w) => {
                    let p = pose(0.3, w);
                    map.merge(MapId(1), MapId(0), &Sim3::new(p.rotation, p.translation, 1.0)).expect("finite");
                }
                Event::Remove(n) => {
                    let ids: Vec<AnchorId> = map.anchors.keys().copied().collect();
                    if ids.len() > 1 {
                        let gone = ids[n % ids.len()];
                        let parent = ids[(n + 1) % ids.len()];
                        if map.anchors[&gone].map == map.anchors[&parent].map {
                            map.remove(gone, parent).expect("a parent");
                        }
                    }
                }
                // Also one that was removed, is to be fused elsewhere, or was forgotten before.
                Event::Forget(id) => forgotten += usize::from(map.forget(AnchorId(id)).expect("whole")),
                Event::Step(n) => {
                    map.step(&Vec3::zeros(), n);
                }
                Event::WantAll(all) => map.want_all(all),
            }
        }
        prop_assert_eq!(map.kept.len() + forgotten, next as usize);
        // Removals leave submaps and frames where they are; no other work may be pending unnoticed.
        map.find_moved();
        map.want_all(true);
        finish(&mut map);
        check(&mut map);
        map.want_all(false);
        map.step(&Vec3::zeros(), 1);
        let whole = map.submaps().filter(|s| s.tsdf.is_some()).count();
        let all = map.submaps().count();
        prop_assert!(whole == if tight { all.min(1) } else { all }, "{} of {}", whole, all);
    }
}

#[test]
fn a_closed_loop_moves_submaps_at_once_and_frames_later() {
    let mut map = DenseMap::new(config(), camera(), 0.001).expect("a camera");
    for i in 0..12 {
        let x = f64::from(i) * 0.4;
        map.insert(AnchorId(i as u64), MapId(0), pose(x, [0.0; 3]), Se3::identity(), &wall(x), None)
            .expect("depth");
    }
    let before: Vec<Se3> = map.submaps().map(|s| s.world_from_submap).collect();
    assert!(before.len() > 1, "{} submaps over 4.4 m", before.len());
    // All move equally: no frame moves inside its submap.
    let shift = pose(0.5, [0.1, 0.0, 0.2]);
    let moved: Vec<_> = (0..12).map(|i| (AnchorId(i), shift * pose(i as f64 * 0.4, [0.0; 3]))).collect();
    map.align(&moved).expect("finite");
    for (submap, before) in map.submaps().zip(&before) {
        assert!(((submap.world_from_submap.inverse() * (shift * *before)).log()).norm() < 1e-9);
    }
    assert_eq!(map.step(&Vec3::zeros(), 100), Progress::default());
    // The last one moves on its own: it alone is pending, and is re-fused within the budget.
    map.align(&[(AnchorId(11), shift * pose(4.4, [0.0, 0.0, 0.1]))]).expect("finite");
    assert_eq!(map.step(&Vec3::zeros(), 1).images, 2);
    finish(&mut map);
    check(&mut map);
}

#[test]
fn merged_maps_are_joined_and_no_wall_is_doubled() {
    let mut map = DenseMap::new(config(), camera(), 0.001).expect("a camera");
    let b_from_a = Se3::new(So3::exp(&Vec3::new(0.2, -0.4, 0.1)), Vec3::new(3.0, 1.0, -2.0));
    for i in 0..4 {
        let x = f64::from(i) * 0.2;
        map.insert(AnchorId(i as u64), MapId(0), pose(x, [0.0; 3]), Se3::identity(), &wall(x), None)
            .expect("depth");
        let id = AnchorId(100 + i as u64);
        map.insert(id, MapId(1), b_from_a * pose(x, [0.0; 3]), Se3::identity(), &wall(x), None)
            .expect("depth");
    }
    assert_eq!(map.submaps().count(), 2);
    let a_from_b = b_from_a.inverse();
    map.merge(MapId(1), MapId(0), &Sim3::new(a_from_b.rotation, a_from_b.translation, 1.0)).expect("finite");
    finish(&mut map);
    assert_eq!(check(&mut map), 1, "one submap is left");
    let submap = map.submaps().next().expect("one");
    assert_eq!(submap.map, MapId(0));
    let mesh = Mesher::new(MeshConfig::of_key_frames()).whole(submap.tsdf.expect("in use"));
    // Two walls of the recording and their edge; nothing between them or behind.
    let off = |z: f32| (z - 2.0).abs().min((z - 1.7).abs());
    let near = mesh.positions.iter().filter(|p| off(p[2]) < 0.01).count();
    assert!(near * 100 > mesh.positions.len() * 97, "{near} of {}", mesh.positions.len());
    assert!(map.fuse_all(MapId(0), config().tsdf).expect("poses").blocks() > 0);
}

#[test]
fn surface_has_the_shades_of_its_images() {
    let in_colour = TsdfConfig { colour: true, ..config().tsdf };
    for colour in [true, false] {
        let tsdf = TsdfConfig { colour, ..in_colour };
        let mut map = DenseMap::new(SubmapConfig { tsdf, ..config() }, camera(), 0.001).expect("a camera");
        let bright = GrayImage::from_vec(80, 60, vec![200; 80 * 60]).expect("all pixels");
        map.insert(AnchorId(0), MapId(0), Se3::identity(), Se3::identity(), &wall(0.0), Some(&bright))
            .expect("depth");
        let small = GrayImage::new(40, 30);
        let refused =
            map.insert(AnchorId(1), MapId(0), Se3::identity(), Se3::identity(), &wall(0.0), Some(&small));
        assert_eq!(
            refused.is_err(),
            colour,
            "a picture of another size, which nobody looks at without colours"
        );
        let mesh = Mesher::new(MeshConfig::of_key_frames())
            .whole(&map.fuse_all(MapId(0), in_colour).expect("poses"));
        assert_eq!(mesh.colours.len(), if colour { mesh.positions.len() } else { 0 });
        assert!(!mesh.positions.is_empty() && mesh.colours.iter().all(|c| *c == [200; 3]));
        // The same of a saved map.
        let mut again = DenseMap::new(config(), camera(), 0.001).expect("a camera");
        again.add_anchor(AnchorId(0), MapId(0), Se3::identity()).expect("finite");
        again.add_anchor(AnchorId(1), MapId(0), Se3::identity()).expect("finite");
        map.saved().into_iter().for_each(|submap| again.restore(submap).expect("known anchors"));
        let same = Mesher::new(MeshConfig::of_key_frames())
            .whole(&again.fuse_all(MapId(0), in_colour).expect("poses"));
        assert_eq!(same.colours, mesh.colours);
    }
}

/// Triangles by the places and colours of their corners, from the lowest one on.
fn triangles(mesh: &crate::Mesh) -> Vec<[([u32; 3], [u8; 3]); 3]> {
    let corner = |i: u32| (mesh.positions[i as usize].map(f32::to_bits), mesh.colours[i as usize]);
    let turned = |t: &[u32; 3]| {
        let mut corners = t.map(corner);
        let lowest = (0..3).min_by_key(|&i| corners[i]).unwrap_or(0);
        corners.rotate_left(lowest);
        corners
    };
    let mut all: Vec<_> = mesh.triangles.iter().map(turned).collect();
    all.sort_unstable();
    all
}

#[test]
fn a_surface_meshed_in_parts_is_that_of_the_whole_field() {
    let tsdf = TsdfConfig { colour: true, ..config().tsdf };
    let mut map = DenseMap::new(SubmapConfig { tsdf, ..config() }, camera(), 0.001).expect("a camera");
    for i in 0..12 {
        let (id, x) = (AnchorId(i as u64), f64::from(i) * 0.4);
        map.insert(id, MapId(0), pose(x, [0.1, 0.0, 0.05]), Se3::identity(), &wall(x), Some(&stripes(x)))
            .expect("depth");
    }
    let config = MeshConfig::of_key_frames();
    let field = map.fuse_all(MapId(0), tsdf).expect("poses");
    let whole = Mesher::new(config).whole(&field);
    for blocks in [1, 40, 100_000] {
        let bytes = blocks * TsdfVolume::block_bytes(&tsdf);
        let parts = map.surface_in_parts(MapId(0), tsdf, config, bytes).expect("poses");
        assert_eq!(parts.positions.len(), whole.positions.len(), "welded, {blocks} blocks a part");
        assert!(triangles(&parts) == triangles(&whole), "{blocks} blocks a part");
        let up = |m: &crate::Mesh| m.normals.iter().map(|n| f64::from(n[2])).sum::<f64>();
        assert!((up(&parts) - up(&whole)).abs() < 1e-3, "{} and {}", up(&parts), up(&whole));
    }
}

/// Two rooms, and room for the field of one: what is shown stays while a field is released, and comes back whole.
#[test]
fn a_released_field_comes_back_whole_where_the_walker_comes_back() {
    let config = SubmapConfig { most_bytes: 0, ..config() };
    let mut map = DenseMap::new(config, camera(), 0.001).expect("a camera");
    let mut shown = SurfaceChanges::new();
    let mut walk = |map: &mut DenseMap, id: u64, x: f64| {
        map.insert(AnchorId(id), MapId(0), pose(x, [0.0; 3]), Se3::identity(), &wall(x), None)
            .expect("depth");
        shown.of(map)
    };
    let full = |change: SurfaceChange| -> Vec<(u32, crate::BlockKey)> {
        change.blocks.iter().filter(|b| !b.2.triangles.is_empty()).map(|b| (b.0, b.1)).collect()
    };
    let drawn: Vec<_> = (0..4).flat_map(|id| full(walk(&mut map, id, 0.1 * id as f64))).collect();
    let room = voxels(map.submaps().next().and_then(|s| s.tsdf).expect("in use"));
    let change = walk(&mut map, 4, 20.0);
    assert_eq!(map.submaps().map(|s| s.tsdf.is_some()).collect::<Vec<_>>(), [false, true]);
    assert!(change.blocks.iter().all(|(number, ..)| *number == 1), "the first room is shown as it was");
    let change = walk(&mut map, 5, 0.4);
    assert!(change.blocks.is_empty() && map.submaps().count() == 2, "its blocks are known");
    assert_eq!(map.step(&Vec3::zeros(), 2).waiting, 1);
    finish(&mut map);
    let change = full(shown.of(&map));
    assert!(!drawn.is_empty() && drawn.iter().all(|block| change.contains(block)));
    let again = voxels(map.submaps().next().and_then(|s| s.tsdf).expect("in use"));
    assert!(room.keys().all(|voxel| again.contains_key(voxel)));
    map.want_all(true);
    finish(&mut map);
    check(&mut map);
    assert!(map.is_complete());
}

#[test]
fn bad_input_leaves_the_map_as_it_was() {
    let mut map = DenseMap::new(config(), camera(), 0.001).expect("a camera");
    let (id, nowhere) = (AnchorId(7), pose(f64::NAN, [0.0; 3]));
    assert!(map.insert(id, MapId(0), nowhere, Se3::identity(), &wall(0.0), None).is_err());
    assert!(
        map.insert(id, MapId(0), Se3::identity(), Se3::identity(), &DepthImage::new(80, 60), None).is_err()
    );
    assert!(
        map.insert(id, MapId(0), pose(1e12, [0.0; 3]), Se3::identity(), &wall(0.0), None).is_ok(),
        "its own origin"
    );
    assert!(map.insert(id, MapId(0), Se3::identity(), Se3::identity(), &wall(0.0), None).is_err(), "twice");
    assert!(map.align(&[(id, nowhere)]).is_err());
    assert!(map.remove(id, AnchorId(99)).is_err());
    assert_eq!(map.submaps().count(), 1);
    assert_eq!(map.step(&Vec3::zeros(), 10).waiting, 0);
}

#[test]
fn a_saved_map_goes_on_as_the_one_it_was_saved_from() {
    let mut map = DenseMap::new(config(), camera(), 0.001).expect("a camera");
    for i in 0..12 {
        let x = f64::from(i) * 0.4;
        map.insert(AnchorId(i as u64), MapId(0), pose(x, [0.0; 3]), Se3::identity(), &wall(x), None)
            .expect("depth");
    }
    // Saved with work waiting: it is done with the poses that were final.
    map.align(&[(AnchorId(11), pose(4.4, [0.0, 0.0, 0.1]))]).expect("finite");
    map.remove(AnchorId(5), AnchorId(4)).expect("a parent");
    let mut again = DenseMap::new(config(), camera(), 0.001).expect("a camera");
    let saved = map.saved();
    assert!(again.restore(saved[0].clone()).is_err(), "its key frames are not there");
    for (id, anchor) in &map.anchors {
        again.add_anchor(*id, anchor.map, anchor.world_from_anchor).expect("finite");
    }
    saved.into_iter().for_each(|submap| again.restore(submap).expect("known anchors"));
    assert_eq!(again.images_of(MapId(0)), 12);
    let whole = |map: &mut DenseMap| voxels(&map.fuse_all(MapId(0), config().tsdf).expect("poses"));
    assert_eq!(whole(&mut again), whole(&mut map), "before any work is done");
    // One more key frame while the work waits, then a loop.
    for map in [&mut map, &mut again] {
        map.insert(AnchorId(20), MapId(0), pose(4.0, [0.0; 3]), Se3::identity(), &wall(4.0), None)
            .expect("depth");
        map.step(&Vec3::zeros(), 3);
        map.align(&[(AnchorId(2), pose(0.8, [0.0, 0.0, -0.1]))]).expect("finite");
        finish(map);
        check(map);
    }
    assert_eq!(whole(&mut again), whole(&mut map));
    let last = again.saved().pop().expect("a submap");
    let small = DenseMap::new(config(), Camera::pinhole(40, 30, 35.0, 35.0, 19.5, 14.5), 0.001);
    let mut small = small.expect("a camera");
    small.add_anchor(last.anchor, MapId(0), Se3::identity()).expect("finite");
    last.frames.iter().for_each(|f| small.add_anchor(f.anchor, MapId(0), Se3::identity()).expect("finite"));
    assert!(matches!(small.restore(last), Err(DenseError::Size { .. })));
}

/// A wall that was seen from both sides, with voxels so large that the truncation distance would be wider than the wall.
#[test]
fn sides_of_a_thin_wall_stay_where_they_are_in_a_whole_map() {
    let (camera, thick) = (camera(), 0.16);
    let facing = DepthImage::from_vec(camera.width, camera.height, vec![1000; camera.width * camera.height]);
    let facing = facing.expect("all pixels");
    let behind =
        Se3::new(So3::exp(&Vec3::new(0.0, std::f64::consts::PI, 0.0)), Vec3::new(0.0, 0.0, 2.0 + thick));
    let mut map = DenseMap::new(config(), camera, 0.001).expect("a camera");
    for (id, at) in [(0, Se3::identity()), (1, behind)] {
        map.insert(AnchorId(id), MapId(0), at, Se3::identity(), &facing, None).expect("depth");
    }
    let tsdf = TsdfConfig { voxel_m: 0.05, ..TsdfConfig::default() };
    let whole = map.fuse_all(MapId(0), tsdf).expect("poses");
    let mesh = Mesher::new(MeshConfig::of_key_frames()).whole(&whole);
    let side = |z: f32| mesh.positions.iter().filter(|p| (p[2] - z).abs() < 0.01).count();
    let (near, far, all) = (side(1.0), side(1.0 + thick as f32), mesh.positions.len());
    assert!(near > 100 && far > 100 && near + far == all, "{near} and {far} of {all} vertices");
    assert!(map.fuse_all(MapId(0), TsdfConfig { band_voxels: 17.0, ..tsdf }).is_err());
}

/// All tiles that were told, as whoever follows has them.
#[derive(Default)]
struct Told {
    axes: Option<crate::walk::ColumnAxes>,
    tiles: BTreeMap<[i32; 2], crate::walk::ColumnTile>,
}

impl Told {
    fn take(&mut self, change: ColumnChange) -> usize {
        if change.axes.is_some() {
            *self = Self { axes: change.axes, ..Self::default() };
        }
        for gone in change.gone {
            assert!(self.tiles.remove(&gone).is_some(), "it was not there");
        }
        let count = change.tiles.len();
        self.tiles.extend(change.tiles.into_iter().map(|tile| (tile.at, tile)));
        count
    }
}

#[test]
fn columns_follow_the_map_and_only_what_has_changed_is_told() {
    let up = -Vec3::y();
    let fresh = |map: &DenseMap| {
        let mut told = Told::default();
        told.take(ColumnChanges::new().of(map, None, &up, &Vec3::zeros(), usize::MAX).expect("columns"));
        told.tiles
    };
    let mut map = DenseMap::new(config(), camera(), 0.001).expect("a map");
    let (mut changes, mut told) = (ColumnChanges::new(), Told::default());
    for k in 0..12_u64 {
        let x = 0.4 * k as f64;
        map.insert(AnchorId(k), MapId(0), pose(x, [0.0; 3]), Se3::identity(), &wall(x), None).expect("depth");
        told.take(changes.of(&map, None, &up, &Vec3::zeros(), 3).expect("columns"));
    }
    // A few at a time, until all are there; then nothing more is told.
    for _ in 0..100 {
        told.take(changes.of(&map, None, &up, &Vec3::zeros(), 3).expect("columns"));
    }
    assert!(told.axes.is_some() && told.tiles.len() > 4, "{} tiles", told.tiles.len());
    assert!(told.tiles == fresh(&map), "what was told piece by piece is what there is");
    assert_eq!(
        changes.of(&map, None, &up, &Vec3::zeros(), usize::MAX).expect("columns"),
        ColumnChange::default()
    );
    // The wall is seen above free space before it: both are in the columns.
    let kinds = |what: u8| told.tiles.values().flat_map(|t| &t.runs).filter(|run| **run >> 6 == what).count();
    assert!(kinds(1) > 500 && kinds(2) > 100, "{} {}", kinds(1), kinds(2));
    // The last key frames move by half a metre: the columns there are others, those far from it stay.
    let moved: Vec<_> = (9..12).map(|k| (AnchorId(k), pose(0.4 * k as f64, [0.0, 0.0, 0.5]))).collect();
    map.align(&moved).expect("poses");
    finish(&mut map);
    let told_again = told.take(changes.of(&map, None, &up, &Vec3::zeros(), usize::MAX).expect("columns"));
    assert!(told_again > 0 && told_again < told.tiles.len(), "{told_again} of {}", told.tiles.len());
    assert!(told.tiles == fresh(&map));
    // Another direction up: all is told anew.
    let change = changes.of(&map, None, &Vec3::z(), &Vec3::zeros(), usize::MAX).expect("columns");
    assert!(change.axes.is_some() && !change.tiles.is_empty());
}

#[test]
fn field_of_a_map_does_not_depend_on_the_order_and_tells_which_key_frame_came_when() {
    let mut map = DenseMap::new(config(), camera(), 0.001).expect("a map");
    for k in [3_u64, 1, 2] {
        let x = 0.4 * k as f64;
        map.insert(AnchorId(k), MapId(0), pose(x, [0.0; 3]), Se3::identity(), &wall(x), None).expect("depth");
    }
    let mut order = Vec::new();
    let tsdf = config().tsdf;
    let field =
        map.fuse_in_order(MapId(0), tsdf, |id, field| order.push((id.0, field.revision()))).expect("a field");
    assert_eq!(order, [(1, 1), (2, 2), (3, 3)]);
    assert!(voxels(&field) == voxels(&map.fuse_all(MapId(0), tsdf).expect("a field")));
}
