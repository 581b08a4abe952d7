//! The map as pages draw it: in whole numbers, so that only what has changed is sent to each.
//!
//! In: views of the session. Out: for a page, the difference from what it was sent last, else everything. Places are 16-bit
//! multiples of a step, a power of two near 1/4096 of the farthest key frame. A place that moves by less than two steps keeps
//! its numbers: what adjustment jiggles is not sent again.
//!
//! A message is little-endian: kind 2, whether it is whole (one byte each), two bytes of nothing, the step and the direction
//! up (32-bit floats); then lists, each with its count (32 bits) in front: points that are gone (numbers of 32 bits), points
//! (number, place), key frames that are gone, key frames (number, place, number of their map), loops (pairs of key frames,
//! always all of them); and twice, for the recorded and the cleaned route, how many places stay (32 bits) and the list of those
//! behind.

use crate::status::View;

/// Steps between the origin and the farthest key frame, at least half of it.
const STEPS: f32 = 4096.0;
/// A place is sent again when it has moved by this many steps.
const MOVED: i32 = 2;
const KIND: u8 = 2;

type Place = [i16; 3];

/// A point or a key frame.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Mark {
    id: u32,
    place: Place,
    /// The map of a key frame; zero for a point.
    map: u32,
}

/// What is drawn.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Drawn {
    step: f32,
    up: [f32; 3],
    points: Vec<Mark>,
    key_frames: Vec<Mark>,
    loops: Vec<[u32; 2]>,
    recorded: Vec<Place>,
    plan: Vec<Place>,
}

impl Drawn {
    /// A view in whole numbers; those of the state before are kept where they still hold.
    pub fn of(view: &View, before: &Self) -> Self {
        let way = view.key_frames.iter().chain(&view.recorded).flatten();
        let far = way.fold(0.0, |far: f32, v| if v.is_finite() { far.max(v.abs()) } else { far });
        let fitting = (far.max(1e-6) / STEPS).log2().ceil().exp2();
        let stays = (fitting..=4.0 * fitting).contains(&before.step);
        let step = if stays { before.step } else { fitting };
        let nothing = Self::default();
        let before = if stays { before } else { &nothing };
        let place = |p: &[f32; 3]| {
            let steps = p.map(|v| (v / step).round());
            steps.iter().all(|v| v.abs() <= f32::from(i16::MAX)).then(|| steps.map(|v| v as i16))
        };
        let marks = |ids: &[u64], places: &[[f32; 3]], maps: &[u64], known: &[Mark]| {
            let mut known = known.iter().peekable();
            let mut marks = Vec::with_capacity(ids.len());
            for (k, (id, p)) in ids.iter().zip(places).enumerate() {
                let (Ok(id), Some(mut place)) = (u32::try_from(*id), place(p)) else { continue };
                while known.next_if(|m| m.id < id).is_some() {}
                if let Some(same) = known.next_if(|m| m.id == id && is_near(m.place, place)) {
                    place = same.place;
                }
                let map = maps.get(k).and_then(|m| u32::try_from(*m).ok()).unwrap_or_default();
                marks.push(Mark { id, place, map });
            }
            marks
        };
        let line = |line: &[[f32; 3]], known: &[Place]| {
            let places = line.iter().filter_map(place).enumerate();
            places.map(|(k, p)| known.get(k).copied().filter(|k| is_near(*k, p)).unwrap_or(p)).collect()
        };
        let id_of = |k: u32| view.key_frame_ids.get(k as usize).and_then(|id| u32::try_from(*id).ok());
        Self {
            step,
            up: view.up,
            points: marks(&view.point_ids, &view.points, &[], &before.points),
            key_frames: marks(&view.key_frame_ids, &view.key_frames, &view.maps, &before.key_frames),
            loops: view.loops.iter().filter_map(|[a, b]| Some([id_of(*a)?, id_of(*b)?])).collect(),
            recorded: line(&view.recorded, &before.recorded),
            plan: line(&view.plan, &before.plan),
        }
    }

    /// The direction up.
    pub fn up(&self) -> [f32; 3] {
        self.up
    }

    /// The message to a page that has drawn `before`.
    pub fn message(&self, before: Option<&Self>) -> Vec<u8> {
        let nothing = Self::default();
        let known = before.filter(|b| b.step == self.step);
        let from = known.unwrap_or(&nothing);
        let mut out = vec![KIND, u8::from(known.is_none()), 0, 0];
        [self.step, self.up[0], self.up[1], self.up[2]].iter().for_each(|v| out.extend(v.to_le_bytes()));
        put_marks(&mut out, &from.points, &self.points, false);
        put_marks(&mut out, &from.key_frames, &self.key_frames, true);
        put_count(&mut out, self.loops.len());
        self.loops.iter().flatten().for_each(|id| out.extend(id.to_le_bytes()));
        for (old, new) in [(&from.recorded, &self.recorded), (&from.plan, &self.plan)] {
            let same = old.iter().zip(new).take_while(|(a, b)| a == b).count();
            put_count(&mut out, same);
            put_count(&mut out, new.len() - same);
            new[same..].iter().for_each(|place| put_place(&mut out, *place));
        }
        out
    }
}

fn is_near(a: Place, b: Place) -> bool {
    a.iter().zip(b).all(|(a, b)| (i32::from(*a) - i32::from(b)).abs() < MOVED)
}

fn put_count(out: &mut Vec<u8>, count: usize) {
    out.extend((count as u32).to_le_bytes());
}

fn put_place(out: &mut Vec<u8>, place: Place) {
    place.iter().for_each(|v| out.extend(v.to_le_bytes()));
}

/// Those that are gone, then those that are new or have changed; both lists are in the order of their numbers.
fn put_marks(out: &mut Vec<u8>, old: &[Mark], new: &[Mark], with_map: bool) {
    let in_order = |list: &[Mark], id: u32| list.binary_search_by_key(&id, |m| m.id).ok().map(|k| list[k]);
    let gone: Vec<u32> = old.iter().map(|m| m.id).filter(|id| in_order(new, *id).is_none()).collect();
    put_count(out, gone.len());
    gone.iter().for_each(|id| out.extend(id.to_le_bytes()));
    let changed: Vec<&Mark> = new.iter().filter(|m| in_order(old, m.id) != Some(**m)).collect();
    put_count(out, changed.len());
    for mark in changed {
        out.extend(mark.id.to_le_bytes());
        put_place(out, mark.place);
        if with_map {
            out.extend(mark.map.to_le_bytes());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    /// A page: what it has drawn, by the messages.
    #[derive(Default)]
    struct Page {
        step: f32,
        points: BTreeMap<u32, Place>,
        key_frames: BTreeMap<u32, (Place, u32)>,
        loops: Vec<[u32; 2]>,
        lines: [Vec<Place>; 2],
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
        fn place(&mut self) -> Place {
            [(); 3].map(|()| i16::from_le_bytes(self.bytes()))
        }
    }

    impl Page {
        fn take(&mut self, message: &[u8]) {
            let mut r = Reader(message);
            let [kind, whole, ..] = r.bytes::<4>();
            assert_eq!(kind, KIND);
            if whole == 1 {
                *self = Self::default();
            }
            self.step = f32::from_le_bytes(r.bytes());
            r.bytes::<12>();
            for _ in 0..r.number() {
                assert!(self.points.remove(&r.number()).is_some());
            }
            for _ in 0..r.number() {
                self.points.insert(r.number(), r.place());
            }
            for _ in 0..r.number() {
                assert!(self.key_frames.remove(&r.number()).is_some());
            }
            for _ in 0..r.number() {
                self.key_frames.insert(r.number(), (r.place(), r.number()));
            }
            self.loops = (0..r.number()).map(|_| [r.number(), r.number()]).collect();
            for line in &mut self.lines {
                line.truncate(r.number() as usize);
                let more = r.number();
                line.extend((0..more).map(|_| r.place()));
            }
            assert!(r.0.is_empty(), "{} bytes are left", r.0.len());
        }

        fn assert_shows(&self, drawn: &Drawn) {
            let points = drawn.points.iter().map(|m| (m.id, m.place)).collect();
            let key_frames = drawn.key_frames.iter().map(|m| (m.id, (m.place, m.map))).collect();
            assert_eq!((self.step, &self.points, &self.key_frames), (drawn.step, &points, &key_frames));
            assert_eq!(
                (&self.loops, &self.lines),
                (&drawn.loops, &[drawn.recorded.clone(), drawn.plan.clone()])
            );
        }
    }

    /// A walk of `n` key frames, its points shifted by `by`.
    fn view(n: u64, by: f32) -> View {
        let at = |k: u64| [0.3 * k as f32 + by, by, -0.1];
        let points: Vec<u64> = (0..20 * n).filter(|id| id % 7 != n % 7).collect();
        View {
            up: [0.0, -1.0, 0.0],
            points: points.iter().map(|id| [0.015 * *id as f32 + by, 1.0, 2.0]).collect(),
            point_ids: points,
            key_frames: (0..n).map(at).collect(),
            key_frame_ids: (0..n).map(|k| 2 * k).collect(),
            maps: vec![n / 50; n as usize],
            loops: if n > 30 { vec![[3, 30]] } else { vec![] },
            recorded: (0..n).map(at).collect(),
            plan: if n.is_multiple_of(3) { vec![at(0), at(n)] } else { vec![] },
            camera: None,
        }
    }

    #[test]
    fn page_that_takes_the_differences_has_the_whole() {
        let (mut drawn, mut page, mut lagging) = (Drawn::default(), Page::default(), Page::default());
        let (mut has, mut lags) = (None, None);
        let mut sizes = Vec::new();
        for n in 1..120 {
            drawn = Drawn::of(&view(n, if n > 60 { 0.4 } else { 0.0 }), &drawn);
            let message = drawn.message(has.as_ref());
            page.take(&message);
            page.assert_shows(&drawn);
            has = Some(drawn.clone());
            sizes.push(message.len());
            // A page over a slow link gets every fifth state.
            if n % 5 == 0 {
                lagging.take(&drawn.message(lags.as_ref()));
                lagging.assert_shows(&drawn);
                lags = Some(drawn.clone());
            }
        }
        // Nothing changes: nothing but the head is sent.
        let same = Drawn::of(&view(119, 0.4), &drawn);
        assert!(same.message(has.as_ref()).len() < 100);
        // Less than two steps is not sent again; and does not add up.
        let mut crept = drawn.clone();
        for k in 1..=100 {
            crept = Drawn::of(&view(119, 0.4 + 0.1 * k as f32 * drawn.step), &crept);
        }
        let off = (f32::from(crept.points[500].place[0]) * crept.step)
            - view(119, 0.4 + 10.0 * drawn.step).points[500][0];
        assert!(off.abs() <= 2.0 * drawn.step, "{off} of {}", drawn.step);
    }

    #[test]
    fn places_that_have_no_numbers_are_left_out() {
        let mut view = view(40, 0.0);
        view.points[3] = [f32::NAN, 0.0, 0.0];
        view.points[4] = [1e30, 0.0, 0.0];
        view.point_ids[5] = u64::MAX;
        view.key_frames[7] = [f32::INFINITY, 0.0, 0.0];
        let drawn = Drawn::of(&view, &Drawn::default());
        assert_eq!((drawn.points.len(), drawn.key_frames.len()), (view.points.len() - 3, 39));
        let mut page = Page::default();
        page.take(&drawn.message(None));
        page.assert_shows(&drawn);
        assert!(drawn.step > 0.0 && drawn.step < 12.0 / 2048.0, "{}", drawn.step);
        let empty = Drawn::of(&View::default(), &drawn);
        Page::default().take(&empty.message(None));
    }
}
