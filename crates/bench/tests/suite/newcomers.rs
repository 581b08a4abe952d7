//! A newcomer with a phone that nobody knows.

/// The lens is known after seven seconds of walking, so that it is the clocks and metres of the walk seen again that make it ready.
#[test]
fn a_phone_is_known_within_half_the_time_and_its_route_is_as_long_as_it_is() {
    let found = bench::newcomers::of("sim:demo?seed=2&turn_rate=0.8&out=12", false).unwrap();
    println!("{found:?}");
    assert!(found.known_s.is_some_and(|s| s <= 20.0) && !found.early && !found.jumped);
    assert!(found.recorded_m.is_some() && !found.wrong);
    assert_eq!(found.end, "arrived");
}
