//! What a page is sent of what is made of the depth: the surface and the columns in turn, together no more than a page may be sent.

use crate::columns::{Columns, SentColumns};
use crate::surface::{Sent, Surface};
use std::time::Instant;

/// What a page has of both.
pub(crate) struct SentDepth {
    surface: Sent,
    columns: SentColumns,
    /// Whether it is the columns' turn.
    turn: bool,
}

impl SentDepth {
    /// A page that has nothing.
    pub fn new(now: Instant) -> Self {
        Self { surface: Sent::new(now), columns: SentColumns::default(), turn: false }
    }

    /// The next message of at most `room` bytes, of what the page wants: of either where the other has nothing; `None` where nothing is to be
    /// sent or nothing may be.
    pub fn message(
        &mut self,
        surface: Option<&Surface>,
        columns: Option<&Columns>,
        room: usize,
        now: Instant,
    ) -> Option<Vec<u8>> {
        self.surface.wait(now);
        self.turn = !self.turn;
        [self.turn, !self.turn].into_iter().find_map(|is_columns| match is_columns {
            true => {
                let message = self.columns.message(columns?, room.min(self.surface.left()))?;
                self.surface.spend(message.len());
                Some(message)
            }
            false => self.surface.message(surface?, room, now),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_dense::walk::{ColumnAxes, ColumnTile};
    use cairn_dense::{BlockKey, ColumnChange, Mesh};
    use cairn_geometry::{Se3, Vec3};
    use std::time::Duration;

    #[test]
    fn both_together_are_no_more_than_a_page_may_be_sent_and_neither_waits_for_the_other() {
        let (mut surface, mut columns) = (Surface::default(), Columns::default());
        surface.voxels(0.02);
        surface.place(0, &Se3::identity());
        let axes = Some(ColumnAxes::new(&Vec3::z(), 0.05));
        columns.take(ColumnChange { axes, ..ColumnChange::default() }, 0);
        let mut now = Instant::now();
        let began = now;
        let mut sent = SentDepth::new(now);
        let mut page = cairn_view::Scene::default();
        let mut log: Vec<(f64, u8, usize)> = Vec::new();
        for tick in 0..240_u32 {
            now += Duration::from_millis(125);
            // Twenty blocks and four tiles change each time: more of each than may be sent of both.
            for k in 0..20 {
                let high = (tick % 4 + 1) as f32;
                let at =
                    |i: usize| [0.16 * k as f32 + 0.0002 * i as f32, 0.001 * (i % 3) as f32, 0.02 * high];
                let positions = (0..200).map(at).collect();
                let triangles = (2..200).map(|i| [i - 2, i - 1, i]).collect();
                surface.set(0, BlockKey([k, 0, 0]), &Mesh { positions, triangles, ..Mesh::default() }, 1);
            }
            let tile = |k: i32| ColumnTile {
                at: [k, 0],
                base: 0,
                runs: [6, 1, 0x41, 0x81, 0x41, 0x81, tick as u8 & 63].repeat(256),
            };
            let tiles = (0..4).map(|k| tile(k + 4 * (tick as i32 % 8))).collect();
            columns.take(ColumnChange { axes: None, gone: Vec::new(), tiles }, 1);
            if let Some(message) = sent.message(Some(&surface), Some(&columns), usize::MAX, now) {
                page.take(&message).unwrap();
                log.push((now.duration_since(began).as_secs_f64(), message[0], message.len()));
            }
        }
        let within = |at: f64| log.iter().filter(move |(t, ..)| (at..at + 1.0).contains(t));
        let most = log.iter().map(|(at, ..)| within(*at).map(|(.., n)| n).sum::<usize>()).max().unwrap();
        assert!((120_000..=200_000).contains(&most), "{most} bytes in a second");
        for second in 1..29 {
            let kinds = [3, 4].map(|kind| within(f64::from(second)).filter(|(_, k, _)| *k == kind).count());
            assert!(kinds[0] > 0 && kinds[1] > 0, "{kinds:?} in second {second}");
        }
        // Once it is quiet, the page has the newest of both; what is not wanted is not sent.
        for _ in 0..100 {
            now += Duration::from_millis(125);
            if let Some(message) = sent.message(Some(&surface), Some(&columns), usize::MAX, now) {
                page.take(&message).unwrap();
            }
        }
        assert_eq!((page.surface.blocks().count(), page.columns.tiles.len()), (20, 32));
        assert_eq!(sent.message(Some(&surface), Some(&columns), usize::MAX, now), None);
        let mut other = SentDepth::new(now);
        let first = other.message(Some(&surface), None, usize::MAX, now).unwrap();
        now += Duration::from_secs(1);
        let second = other.message(None, Some(&columns), usize::MAX, now).unwrap();
        assert_eq!((first[0], second[0], other.message(None, None, usize::MAX, now)), (3, 4, None));
    }
}
