//! Cleaning of recordings of random walks.

use cairn_guide::{CleanConfig, Ground, clean};
use cairn_trial::walk::{Noise, random_route, walk_out};

#[test]
fn few_segments_are_shorter_than_a_metre() {
    let mut short = 0;
    let mut all = 0;
    for seed in 0..20 {
        let route = walk_out(&random_route(seed, false), Noise::Usual, seed);
        let placed = route.as_recorded();
        let cleaned = clean(&placed, 1.0, &Ground::z_up(), &CleanConfig::default());
        all += cleaned.points.len() - 1;
        short += cleaned.points.windows(2).filter(|w| (w[1] - w[0]).norm() < 1.0).count();
        assert!(cleaned.largest_distance_to(&placed, 1.0) <= 0.31);
    }
    assert!(short * 10 <= all, "{short} of {all} segments are shorter than a metre");
}
