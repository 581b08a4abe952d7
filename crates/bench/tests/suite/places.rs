//! Limits for place recognition on the photographs with a loop matrix, slightly below the figures of docs/figures/places.md. A
//! limit is tightened when recognition improves, and never loosened to make a test pass.

use bench::data_folder;
use bench::places::loops::{self, CANDIDATES, Gate};
use bench::places::page::{ENOUGH, SOME, Verdict, words_alone};
use cairn_vision::bow::Vocabulary;

#[test]
fn verified_pairs_are_in_the_loop_matrix() {
    let data = data_folder();
    let Some(walk) = loops::read(&data, Vocabulary::embedded()).expect("the photographs can be read") else {
        println!("skipped: loops is not in {}", data.display());
        return;
    };
    assert_eq!((walk.views.len(), walk.true_pairs().len()), (84, 228));
    let pairs = walk.verified(CANDIDATES);
    assert_eq!(pairs, walk.verified(CANDIDATES), "verification is not deterministic");
    let enough = Verdict::of(&walk, &pairs, Gate::default(), ENOUGH);
    let some = Verdict::of(&walk, &pairs, Gate::default(), SOME);
    println!("{enough:?}, of pairs with some overlap {}", some.recall());
    assert_eq!(enough.wrong, [], "accepted but not in the matrix");
    assert!(enough.enough >= 60 && enough.recall() >= 0.95, "{enough:?}");
    assert!(some.enough >= 100 && some.recall() >= 0.8, "{some:?}");
    let [clean, mean] = words_alone(&walk);
    assert!(clean >= 0.3 && mean >= 0.6, "words alone: {clean}, {mean}");
}
