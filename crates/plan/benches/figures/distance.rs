//! The distance transform: the whole map, a window, and the update after a change.

use crate::{obstacles, repeat};
use cairn_plan::{Cell, DistanceField, Grid, GridFrame};
use std::hint::black_box;

pub fn figures(willow: &Grid<i8>) {
    let blocked = obstacles(willow);
    let (w, h) = (willow.frame().width(), willow.frame().height());
    println!("distance transform, exact, {w} x {h} (goal: 6 ms)");
    let mut field = DistanceField::new(&blocked);
    repeat("squared distances", || field.recompute(black_box(blocked.values())));
    let mut metres = vec![0f32; blocked.values().len()];
    repeat("squared distances and their roots in metres, f32", || {
        field.recompute(black_box(blocked.values()));
        metres.iter_mut().zip(field.squared()).for_each(|(m, &s)| *m = 0.05 * (s as f32).sqrt());
        black_box(&mut metres);
    });
    for (name, every) in [("one obstacle in 100 cells", 100), ("one obstacle in all", usize::MAX)] {
        let mut few = blocked.map(|_| false);
        let mut random = cairn_random::Random::new(1);
        let len = few.frame().len();
        for _ in 0..(len / every).max(1) {
            few.values_mut()[random.below(len)] = true;
        }
        repeat(name, || field.recompute(black_box(few.values())));
    }
    let corner = (w / 2 - 100, h / 2 - 100);
    let frame = GridFrame::unit(200, 200).expect("a window");
    let mut window = Grid::filled(frame, false);
    for i in 0..frame.len() {
        let c = frame.cell(i);
        let at = Cell::new(c.x + corner.0 as u32, c.y + corner.1 as u32);
        window.values_mut()[i] = blocked.get(at).unwrap_or(true);
    }
    let mut local = DistanceField::new(&window);
    repeat("window of 200 x 200 (goal: 0.3 ms)", || local.recompute(black_box(window.values())));
    let mut changing = blocked.clone();
    field.recompute(blocked.values());
    // The cell farthest from every obstacle.
    let middle = (0..field.squared().len()).max_by_key(|&i| field.squared()[i]).expect("cells");
    let patch: Vec<Cell> =
        (0..100).map(|k| Cell::new((middle % w + k % 10) as u32, (middle / w + k / 10) as u32)).collect();
    let (mut on, mut rows) = (true, 0);
    repeat("mended after a patch of 10 x 10 cells came or went", || {
        patch.iter().for_each(|&c| {
            changing.set(c, on || blocked.get(c) == Some(true));
        });
        rows = rows.max(field.update(&changing, &patch).len());
        on = !on;
    });
    println!("    at most {rows} of {h} rows again");
}
