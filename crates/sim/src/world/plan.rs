//! Rooms as rectangles: the cells between all their edges become walls, floors and ceilings.
//!
//! Where a higher room meets a lower one (a door in its wall), the wall above the lower one remains.

use super::build::{Builder, Lamp};
use crate::texture::{Decor, Material};
use cairn_geometry::{Vec2, Vec3};
use cairn_random::Random;

/// How a room's walls are decorated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Dress {
    /// Doors, boards, notices.
    Corridor,
    /// Pictures, windows, boards.
    Room,
    /// Big pictures and windows.
    Hall,
    /// As in a hall, and pictures in rows up to the ceiling.
    Gallery,
    /// Nothing at all.
    Plain,
    /// Nothing: the jamb of a door.
    Bare,
}

/// A rectangle of floor with a height and an appearance.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Room {
    /// `[x0, y0, x1, y1]` in metres.
    pub area: [f64; 4],
    /// Height of the ceiling.
    pub height: f64,
    /// Coat of the walls.
    pub wall: Material,
    /// Coat of the floor.
    pub floor: Material,
    /// The decoration of the walls.
    pub dress: Dress,
    /// Stream of randomness; rooms of one stream look alike.
    pub stream: u64,
}

/// Builds walls, floors and ceilings of rooms that do not overlap.
pub(crate) fn build(b: &mut Builder, rooms: &[Room]) {
    let walled = rooms.iter().any(|r| r.dress == Dress::Room);
    for room in rooms {
        b.areas.push(room.area);
        lamps(b, room, walled);
    }
    for room in rooms {
        slab(b, room);
    }
    for (axis, other) in [(0, 1), (1, 0)] {
        walls(b, rooms, axis, other);
    }
}

fn lamps(b: &mut Builder, room: &Room, walled: bool) {
    let [x0, y0, x1, y1] = room.area;
    if room.dress == Dress::Bare {
        return;
    }
    let (nx, ny) = (((x1 - x0) / 3.5).ceil().max(1.0), ((y1 - y0) / 3.5).ceil().max(1.0));
    for i in 0..nx as usize {
        for j in 0..ny as usize {
            let (x, y) = (x0 + (i as f64 + 0.5) * (x1 - x0) / nx, y0 + (j as f64 + 0.5) * (y1 - y0) / ny);
            let at = Vec3::new(x, y, room.height - 0.05);
            b.lights.push(Lamp { at, power: 0.62, room: walled.then_some(room.area) });
        }
    }
}

/// Floor and ceiling.
fn slab(b: &mut Builder, room: &Room) {
    let [x0, y0, x1, y1] = room.area;
    let (w, d) = (x1 - x0, y1 - y0);
    let (x, y) = (Vec3::x(), Vec3::y());
    b.stream(room.stream ^ 0xF1);
    b.quad([Vec3::new(x0, y1, 0.0), x, -y], w, d, 0.006, |c, r| {
        room.floor.coat(c);
        Decor::wear(c, r, 3.0, 60.0);
    });
    b.stream(room.stream ^ 0xCE);
    let (bare, height) = (room.dress == Dress::Bare, room.height);
    b.quad([Vec3::new(x0, y0, height), x, y], w, d, 0.01, |c, r| {
        if bare {
            Material::Board(110.0).coat(c);
            return;
        }
        Material::Panels(188.0).coat(c);
        let (cw, ch) = (c.width_m(), c.height_m());
        let (nx, ny) = ((cw / 3.5).ceil().max(1.0), (ch / 3.5).ceil().max(1.0));
        for i in 0..(nx * ny) as usize {
            let (cx, cy) = ((i as f32 % nx + 0.5) * cw / nx, ((i as f32 / nx).floor() + 0.5) * ch / ny);
            c.rect(cx - 0.6, cy - 0.15, 1.2, 0.3, 60.0, 1.0);
            c.rect(cx - 0.57, cy - 0.12, 1.14, 0.24, 255.0, 1.0);
            c.line((cx - 0.57, cy), (cx + 0.57, cy), 0.02, 190.0, 1.0);
        }
        for _ in 0..(cw * ch * 0.25) as usize {
            let (px, py) = (r.uniform_f32(0.0, cw), r.uniform_f32(0.0, ch));
            if r.chance(0.5) {
                c.disc(px, py, 0.07, 60.0, 1.0);
                c.disc(px, py, 0.045, 215.0, 1.0);
            } else {
                c.rect(px, py, 0.28, 0.28, 70.0, 1.0);
                for k in 0..5 {
                    c.rect(px + 0.02, py + 0.02 + 0.05 * k as f32, 0.24, 0.02, 200.0, 1.0);
                }
            }
        }
    });
}

/// Walls across one axis: between neighbouring cells of different height, in runs.
fn walls(b: &mut Builder, rooms: &[Room], axis: usize, other: usize) {
    let lines = |k: usize| {
        let mut v: Vec<f64> = rooms.iter().flat_map(|r| [r.area[k], r.area[k + 2]]).collect();
        v.sort_by(f64::total_cmp);
        v.dedup_by(|a, b| (*a - *b).abs() < 1e-6);
        v
    };
    let (along, across) = (lines(other), lines(axis));
    let owner = |p: f64, q: f64| {
        rooms.iter().position(|r| {
            p > r.area[axis] && p < r.area[axis + 2] && q > r.area[other] && q < r.area[other + 2]
        })
    };
    for &line in &across {
        let mut run: Option<(usize, bool, f64, f64, f64)> = None;
        for w in along.windows(2) {
            let mid = 0.5 * (w[0] + w[1]);
            let (low, high) = (owner(line - 1e-4, mid), owner(line + 1e-4, mid));
            let height = |o: Option<usize>| o.map_or(0.0, |i| rooms[i].height);
            let (a, c) = (height(low), height(high));
            let here = if (a - c).abs() < 1e-6 {
                None
            } else if a > c {
                low.map(|i| (i, false, c, w[0], w[1]))
            } else {
                high.map(|i| (i, true, a, w[0], w[1]))
            };
            match (&mut run, here) {
                (Some(r), Some(h)) if (r.0, r.1, r.2) == (h.0, h.1, h.2) => r.4 = h.4,
                (_, h) => {
                    if let Some(done) = run.take() {
                        wall(b, &rooms[done.0], axis, line, done);
                    }
                    run = h;
                }
            }
        }
        if let Some(done) = run {
            wall(b, &rooms[done.0], axis, line, done);
        }
    }
}

/// One wall: `(room, the room lies on the upper side of the line, bottom, from, to)`.
fn wall(
    b: &mut Builder,
    room: &Room,
    axis: usize,
    line: f64,
    (_, up, z0, from, to): (usize, bool, f64, f64, f64),
) {
    let point = |p: f64, q: f64| if axis == 0 { Vec2::new(p, q) } else { Vec2::new(q, p) };
    if z0 < 1.9 {
        b.plan.push((point(line, from), point(line, to)));
    }
    let into_room = if axis == 0 { Vec3::x() } else { Vec3::y() } * if up { 1.0 } else { -1.0 };
    let right = (-into_room).cross(&Vec3::z());
    let (a, c) = (point(line, from), point(line, to));
    let start = if (c - a).dot(&right.xy()) > 0.0 { a } else { c };
    let frame = [Vec3::new(start.x, start.y, room.height), right, -Vec3::z()];
    let corner = (room.area[0] * 7.0 + line * 13.0 + from * 3.0) as i64 as u64;
    let local = ((line - room.area[axis]) * 8.0).round() as i64 as u64;
    // Rooms of one stream look alike: the position in the room counts, not the position in the world.
    let place = if room.stream < 1 << 32 {
        local ^ (up as u64) << 8 ^ ((to - from) * 10.0).round() as u64
    } else {
        corner
    };
    b.stream(room.stream ^ place.wrapping_mul(31) ^ (axis as u64) << 40 ^ 0x3A11);
    let poor = b.options.poor_walls;
    let room = *room;
    let full = z0 < 0.1;
    b.quad(frame, to - from, room.height - z0, 0.004, move |c, r| {
        if r.chance(poor) && room.dress != Dress::Bare {
            Material::Plain(172.0).coat(c);
            return;
        }
        room.wall.coat(c);
        if matches!(room.dress, Dress::Bare | Dress::Plain) {
            return;
        }
        Decor::wear(c, r, 5.0, 58.0);
        if room.dress == Dress::Gallery {
            rows(c, r);
        }
        if full {
            dress(c, r, room.dress);
        }
    });
}

/// Hangs pictures in rows above what hangs at the height of people.
fn rows(c: &mut crate::texture::Canvas<'_>, r: &mut Random) {
    let (w, h) = (c.width_m(), c.height_m());
    let mut y = h - 2.5;
    while y > 0.2 {
        let row = r.uniform_f32(0.7, 1.1).min(y - 0.1);
        let mut x = r.uniform_f32(0.1, 0.8);
        while x < w - 0.5 && row > 0.3 {
            let pw = r.uniform_f32(0.5, 1.4).min(w - x - 0.1);
            Decor::picture(c, r, x, y - row, pw, row);
            x += pw + r.uniform_f32(0.15, 0.7);
        }
        y -= row + r.uniform_f32(0.15, 0.4);
    }
}

/// Hangs things side by side along a wall.
fn dress(c: &mut crate::texture::Canvas<'_>, r: &mut Random, dress: Dress) {
    let (w, h) = (c.width_m(), c.height_m());
    let skirting = r.uniform_f32(40.0, 110.0);
    c.rect(0.0, h - 0.1, w, 0.1, skirting, 1.0);
    c.rect(0.0, h - 0.105, w, 0.008, 215.0, 1.0);
    if r.chance(0.4) {
        let y = h - 0.95;
        c.rect(0.0, y, w, 0.09, r.uniform_f32(60.0, 120.0), 1.0);
    }
    if r.chance(0.5) {
        let y = r.uniform_f32(0.12, 0.35);
        c.rect(0.0, y, w, 0.06, r.uniform_f32(90.0, 225.0), 1.0);
        c.rect(0.0, y + 0.05, w, 0.012, 60.0, 0.8);
    }
    let mut x = r.uniform_f32(0.15, 0.7);
    while x < w - 0.3 {
        let room = w - x - 0.15;
        let pick = r.below(10);
        let used = match (dress, pick) {
            (Dress::Corridor, 0..=2) if room > 1.4 => {
                Decor::door(c, r, x + 0.1, 0.92, 2.05);
                1.35
            }
            (Dress::Corridor, 3..=4) | (Dress::Room, 0..=1) if room > 1.3 => {
                let bw = r.uniform_f32(1.0, 1.8).min(room);
                let bh = r.uniform_f32(0.7, 1.0);
                Decor::board(c, r, x, h - 1.9, bw, bh);
                bw
            }
            (Dress::Room | Dress::Hall | Dress::Gallery, 2..=4) if room > 1.5 => {
                let (ww, wh) = (r.uniform_f32(1.0, 1.4), r.uniform_f32(1.0, 1.3));
                Decor::window(c, r, x + 0.12, h - 2.25, ww, wh);
                ww + 0.3
            }
            (Dress::Hall | Dress::Gallery, 5..=7) if room > 2.0 => {
                let (pw, ph) = (r.uniform_f32(1.2, 1.9), r.uniform_f32(1.0, 1.8));
                Decor::picture(c, r, x, h - 1.0 - ph, pw, ph);
                pw
            }
            (_, 5..=6) => {
                let (nw, nh) = (0.21_f32.min(room), 0.297);
                let y = h - r.uniform_f32(1.4, 1.9);
                for k in 0..2 + r.below(2) {
                    Decor::notice(c, r, x, y + k as f32 * (nh + 0.03), nw, nh);
                }
                nw
            }
            (_, 7) => {
                // A switch, a socket and a cable to the ceiling.
                let cx = x + 0.06;
                c.line((cx, 0.0), (cx, h - 1.2), 0.02, 225.0, 1.0);
                c.line((cx + 0.016, 0.0), (cx + 0.016, h - 1.2), 0.008, 60.0, 0.8);
                c.rect(x, h - 1.2, 0.12, 0.12, 235.0, 1.0);
                c.frame(x, h - 1.2, 0.12, 0.12, 0.01, 60.0);
                c.rect(x + 0.045, h - 1.17, 0.03, 0.06, 120.0, 1.0);
                c.rect(x, h - 0.38, 0.09, 0.09, 230.0, 1.0);
                c.disc(x + 0.045, h - 0.335, 0.03, 40.0, 1.0);
                0.2
            }
            _ => {
                let (pw, ph) = (r.uniform_f32(0.35, 1.0).min(room), r.uniform_f32(0.35, 0.9));
                Decor::picture(c, r, x, h - 1.05 - ph, pw, ph);
                pw
            }
        };
        x += used + r.uniform_f32(0.15, 0.9);
    }
}
