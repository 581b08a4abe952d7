//! Small scenes: a walker stands before something in a corridor, and what he is told is looked at.

use super::super::watch::{Found, ObstacleScan, Watch};
use cairn_dense::walk::Blocked;
use cairn_geometry::{Camera, Odom, Pose, Se3, So3, Vec2, Vec3};
use cairn_guide::{
    Confidence, Facing, Ground, Guide, GuideConfig, GuideInput, ManeuverPlan, ManeuverPlanConfig, Step,
};
use cairn_sensor::Stamp;

/// Walls beside a route along x, and what stands there.
fn corridor(half_m: f64, boxes: &[[f64; 4]]) -> Vec<Blocked> {
    let blocked = |x: f64, y: f64| Blocked { at: Vec2::new(x, y), low_m: 0.13, voxels: 8 };
    let mut out: Vec<Blocked> =
        (-40..160).flat_map(|k| [half_m, -half_m].map(|y| blocked(0.05 * f64::from(k) + 0.025, y))).collect();
    for [x0, x1, y0, y1] in boxes {
        let count = |a: f64, b: f64| ((b - a) / 0.05).round() as i32;
        for i in 0..count(*x0, *x1) {
            let x = x0 + 0.05 * f64::from(i) + 0.025;
            out.extend((0..count(*y0, *y1)).map(|j| blocked(x, y0 + 0.05 * f64::from(j) + 0.025)));
        }
    }
    out
}

/// A watch over a walker who goes where he is put.
struct Scene {
    watch: Watch,
    guide: Guide,
    now: Stamp,
    obstacles: Vec<Blocked>,
}

impl Scene {
    fn new(obstacles: Vec<Blocked>) -> Self {
        let line: Vec<Vec3> = (0..=40).map(|k| Vec3::new(0.5 * f64::from(k), 0.0, 1.3)).collect();
        let ground = Ground::z_up();
        let plan = ManeuverPlan::new(&line, &ground, &ManeuverPlanConfig::default()).expect("a plan");
        let guide = Guide::new(plan, ground, GuideConfig::default()).expect("a guide");
        Self { watch: Watch::new(), guide, now: Stamp(0), obstacles }
    }

    /// A step with the walker at a place, with a heading in radians.
    fn step(&mut self, x: f64, y: f64, heading: f64) -> Found {
        self.now = self.now.plus_seconds(0.05);
        let ahead = Vec3::new(heading.cos(), heading.sin(), 0.0);
        let right = Vec3::new(heading.sin(), -heading.cos(), 0.0);
        let axes = nalgebra::Matrix3::from_columns(&[right, -Vec3::z(), ahead]);
        let pose: Pose<Odom, Camera> = Pose::new(Se3::new(So3::from_matrix(&axes), Vec3::new(x, y, 1.3)));
        let walker = Facing::Home.heading(&Ground::z_up(), &pose).expect("a heading");
        let obstacles: Vec<Blocked> =
            self.obstacles.iter().filter(|b| (b.at - walker.position).norm() < 4.4).copied().collect();
        let sight = ObstacleScan { obstacles, reach_m: 4.4, chest_m: 1.1, drop_along: &|_, _, _| None };
        let found = self.watch.look(&self.guide, &walker, sight, self.now);
        let hazard = found.clone().tell(&mut self.guide);
        self.guide.step(&GuideInput {
            now: self.now,
            pose_stamp: self.now,
            odom_from_camera: pose,
            confidence: Confidence::Good,
            speed: None,
            hazard,
        });
        found
    }

    /// He stands there for so many seconds; what was found last.
    fn stand(&mut self, seconds: f64, x: f64, y: f64, heading: f64) -> Found {
        let mut found = Found::default();
        for _ in 0..(seconds / 0.05) as usize {
            found = self.step(x, y, heading);
        }
        found
    }

    /// He goes straight from one place to another in so many seconds.
    fn go(&mut self, seconds: f64, from: [f64; 2], to: [f64; 2], heading: f64) -> Found {
        let (mut found, steps) = (Found::default(), (seconds / 0.05) as usize);
        for k in 1..=steps {
            let s = k as f64 / steps as f64;
            found = self.step(from[0] + s * (to[0] - from[0]), from[1] + s * (to[1] - from[1]), heading);
        }
        found
    }
}

/// The side of a step.
fn step(found: &Found) -> Option<f64> {
    found.step.map(|step| step.side())
}

/// The side to which he who faces along the route is led: plus one for left, zero for none.
fn side(found: &Found) -> f64 {
    step(found).or(found.detour.filter(|heading| heading.abs() > 0.1)).map_or(0.0, f64::signum)
}

/// A box to the right of the middle: there is room on the left.
const RIGHT: [f64; 4] = [3.0, 3.4, -0.5, 0.1];

#[test]
fn a_step_is_made_before_the_next_is_planned_and_to_the_side_with_room() {
    let mut scene = Scene::new(corridor(1.2, &[RIGHT]));
    let found = scene.stand(4.0, 1.6, -0.1, 0.0);
    assert_eq!(found.step, Some(Step::BackAside(1.0)), "{found:?}");
    // He begins to step: nothing else is planned from halfway.
    let found = scene.go(0.3, [1.6, -0.1], [1.57, -0.07], 0.0);
    assert_eq!(found.step, Some(Step::BackAside(1.0)), "{found:?}");
    // He stands where it led, and is told no other step while nothing is planned from there.
    scene.go(0.7, [1.57, -0.07], [1.25, 0.25], 0.0);
    let found = scene.stand(0.6, 1.25, 0.25, 0.0);
    assert_eq!((found.step, found.detour), (None, None), "{found:?}");
    let found = scene.stand(2.0, 1.25, 0.25, 0.0);
    assert_eq!(step(&found), Some(1.0), "{found:?}");
    scene.go(1.0, [1.25, 0.25], [0.9, 0.6], 0.0);
    let found = scene.stand(2.0, 0.9, 0.6, 0.0);
    assert!(found.detour.is_some_and(|heading| heading.abs() < 0.01), "{found:?}");
}

#[test]
fn a_small_step_leads_into_a_gap_that_is_narrow() {
    // A gap of 0.8 m, of which the middle is 0.2 m to the left of him.
    let mut scene = Scene::new(corridor(1.2, &[[3.0, 3.4, -1.2, -0.2], [2.6, 3.6, 0.6, 1.2]]));
    let found = scene.stand(4.0, 1.2, 0.0, 0.0);
    assert_eq!(found.step, Some(Step::Aside(1.0)), "{found:?}");
    // It cannot be made: it is not tried again from there.
    let found = scene.stand(12.0, 1.2, 0.0, 0.0);
    assert_ne!(found.step, Some(Step::Aside(1.0)), "{found:?}");
    scene.go(0.5, [1.2, 0.0], [1.2, 0.2], 0.0);
    let found = scene.stand(2.0, 1.2, 0.2, 0.0);
    assert!(found.step.is_none() && (found.stop.is_none() || found.detour.is_some()), "{found:?}");
}

#[test]
fn a_side_is_kept_where_the_other_is_little_nearer() {
    let mut scene = Scene::new(corridor(1.5, &[[3.0, 3.4, -0.45, 0.0]]));
    assert_eq!(side(&scene.stand(4.0, 1.6, -0.1, 0.0)), 1.0);
    // He gets to where the other side is nearer by a step: the side stays.
    scene.go(1.0, [1.6, -0.1], [1.3, -0.4], 0.0);
    assert_eq!(side(&scene.stand(3.0, 1.3, -0.4, 0.0)), 1.0);
    // Something closes that side: then the other, once he was led there in vain.
    scene.obstacles = corridor(1.5, &[[3.0, 3.4, -0.45, 1.5]]);
    scene.go(1.0, [1.3, -0.4], [1.0, -0.45], 0.0);
    assert_eq!(side(&scene.stand(16.0, 1.0, -0.45, 0.0)), -1.0);
}

#[test]
fn nobody_is_told_to_walk_where_nothing_leads_past() {
    // Closed from wall to wall, too near to walk on, and no room beside him: no heading is offered, wherever he faces.
    let mut scene = Scene::new(corridor(0.55, &[[1.6, 2.0, -0.55, 0.55]]));
    for heading in [0.0, 0.1, -0.1, 0.2, -0.2, 0.3, -0.3] {
        let found = scene.stand(4.0, 0.6, 0.0, heading);
        assert_eq!((found.detour, found.step), (None, None), "{heading}: {found:?}");
        assert!(found.stop.is_some());
    }
}

#[test]
fn who_is_led_past_may_set_out_or_is_directed_anew() {
    // Whatever he is offered and has faced for a while, the guide may send him there: else he would stand without a word.
    for wide in [0.5, 0.7] {
        let mut scene = Scene::new(corridor(1.2, &[[2.6, 3.0, -1.2, 1.2 - wide]]));
        for k in -3..=3 {
            let heading = 0.16 * f64::from(k);
            let found = scene.stand(6.0, 0.8, 1.2 - 0.5 * wide, heading);
            let (Some(detour), Some(free)) = (found.detour, found.free) else { continue };
            let faces = (detour - heading).abs() < 0.17;
            assert!(!faces || free.admits(heading), "{wide} {heading} {detour}");
        }
    }
}
