//! Whole builds over a few simulated recordings, in this process: what becomes one, the same result after any interruption, and
//! fetching a tile by place.

use cairn::sim::{SimConfig, SimSource, write_tum};
use cairn_fleet::{
    Answer, Build, Digest, Evidence, Fetched, Job, Outcome, Report, StepResult, Task, fetch, open, query_of,
    run,
};
use std::path::{Path, PathBuf};

/// A fresh folder.
fn folder(name: &str) -> PathBuf {
    let path = std::env::temp_dir().join(format!("cairn-fleet-{}-{name}", std::process::id()));
    let _ = std::fs::remove_dir_all(&path);
    std::fs::create_dir_all(&path).unwrap();
    path
}

/// Writes a walk of a house.
fn record(folder: &Path, seed: u32, options: &str) {
    let world = format!("sim:demo?seed={seed}&sensor=rgbd&resolution=320x240&focal=210&rate=10&{options}");
    write_tum(folder, &mut SimSource::new(&SimConfig::parse(&world).unwrap()).unwrap()).unwrap();
}

/// Two walks each of two houses, and what is no recording.
fn recordings(to: &Path) {
    record(&to.join("a-1"), 11, "start=0&duration=8&height=1.3");
    record(&to.join("a-2"), 11, "start=2&duration=8&speed=1.0&height=1.4");
    record(&to.join("b-1"), 12, "start=0&duration=8&height=1.3");
    record(&to.join("b-2"), 12, "start=2&duration=8&speed=1.0&height=1.4");
    std::fs::create_dir(to.join("empty")).unwrap();
}

/// Drives a build to its end.
fn drive(job: &Job, mut done: impl FnMut(&Job, &Task) -> Outcome) -> Report {
    let mut build = Build::new(job.clone()).unwrap();
    let mut tasks = build.next(Vec::new()).unwrap();
    while !tasks.is_empty() {
        let outcomes = tasks.iter().map(|task| done(job, task)).collect();
        tasks = build.next(outcomes).unwrap();
    }
    build.report().clone()
}

fn digest_of(report: &Report) -> Digest {
    report.digest.expect("something was published")
}

#[test]
fn walks_of_one_house_become_one_atlas_and_interruptions_change_nothing() {
    let root = folder("whole");
    let from = root.join("recordings");
    std::fs::create_dir(&from).unwrap();
    recordings(&from);
    let job = |store: &str| Job {
        overlap_m: 2.0,
        tile_m: 4.0,
        margin_m: 1.0,
        shards: 2,
        ..Job::new(from.to_str().unwrap(), root.join(store).to_str().unwrap())
    };

    let whole = drive(&job("whole"), |job, task| run(job, task).unwrap());
    println!("{}", serde_json::to_string_pretty(&whole).unwrap());
    assert_eq!((whole.recordings, whole.maps, whole.unmapped.len()), (5, 4, 1));
    assert_eq!(whole.unmapped[0].0, "empty");
    let mut joined: Vec<(&str, &str)> = Vec::new();
    for (a, b) in &whole.joined {
        joined.push((a.min(b), a.max(b)));
    }
    joined.sort();
    assert_eq!(joined, [("a-1", "a-2"), ("b-1", "b-2")]);
    assert_eq!(whole.atlases.len(), 2, "{:?}", whole.atlases);
    assert!(whole.tiles >= 4 && whole.tile_key_frames > whole.key_frames, "{whole:?}");

    // Where they would have to overlap over more than they were walked, all stay apart, and it is said why.
    let strict = drive(&Job { overlap_m: 50.0, ..job("whole") }, |job, task| run(job, task).unwrap());
    assert_eq!((strict.atlases.len(), strict.verified), (4, 0));
    assert!(
        strict.apart.len() == 2 && strict.apart[0].contains("two rooms that look alike"),
        "{:?}",
        strict.apart
    );
    drive(&job("whole"), |job, task| run(job, task).unwrap());

    // Killed after three tasks of every step, each time begun anew; workers left half-written files behind, and others did the same
    // task at the same time.
    let killed = job("killed");
    for patience in [1, 3, 9] {
        let mut left = patience;
        let mut build = Build::new(killed.clone()).unwrap();
        let mut tasks = build.next(Vec::new()).unwrap();
        while left > 0 && !tasks.is_empty() {
            let mut outcomes = Vec::new();
            // The last one first: no order is promised.
            for task in tasks.iter().rev().take(left) {
                outcomes.push(run(&killed, task).unwrap());
            }
            left -= outcomes.len();
            if outcomes.len() < tasks.len() {
                break;
            }
            outcomes.reverse();
            tasks = build.next(outcomes).unwrap();
        }
        std::fs::create_dir_all(root.join("killed/steps")).unwrap();
        std::fs::write(root.join("killed/steps/.part-9-9"), b"half").unwrap();
    }
    let again = drive(&killed, |job, task| {
        let both = std::thread::scope(|scope| {
            let other = scope.spawn(|| run(job, task).unwrap());
            [run(job, task).unwrap(), other.join().unwrap()]
        });
        assert_eq!(both[0].result, both[1].result);
        both[0].clone()
    });
    assert_eq!(digest_of(&again), digest_of(&whole));
    let costs = again.costs.iter().find(|c| c.step == "map").unwrap();
    assert_eq!(
        (costs.tasks, costs.reused),
        (5, 4),
        "maps were made before, the folder without images is tried again"
    );
    let published = |store: &str| std::fs::read(root.join(store).join("atlas.json")).unwrap();
    assert_eq!(published("whole"), published("killed"));

    // A third walk finds a tile of its house, and is tracked in it; a walk of another house is not.
    let store = open(root.join("whole").to_str().unwrap()).unwrap();
    record(&root.join("third"), 11, "start=3&duration=4&height=1.35");
    let query = query_of(root.join("third").to_str().unwrap()).unwrap();
    let Answer::Place(fetched, bytes) = fetch(&*store, &query).unwrap() else {
        panic!("a tile of this house")
    };
    println!("{}", serde_json::to_string_pretty(&fetched).unwrap());
    let about: serde_json::Value = serde_json::from_slice(&published("whole")).unwrap();
    let source = &about["atlases"][fetched.tile.atlas as usize]["sources"][0]["recordings"][0];
    assert!(source.as_str().unwrap().starts_with("a-"), "{source}");
    assert_eq!((Digest::of(&bytes), bytes.len() as u64), (fetched.tile.map.digest, fetched.tile.map.bytes));
    record(&root.join("elsewhere"), 77, "start=3&duration=4&height=1.35");
    let query = query_of(root.join("elsewhere").to_str().unwrap()).unwrap();
    assert!(matches!(fetch(&*store, &query).unwrap(), Answer::Unknown(Some(Evidence::Tracked([0..15, _])))));

    // A recording that is added is mapped; all other maps stay.
    record(&from.join("a-3"), 11, "start=3&duration=8&height=1.35");
    let more = drive(&job("whole"), |job, task| run(job, task).unwrap());
    let costs = more.costs.iter().find(|c| c.step == "map").unwrap();
    assert_eq!((costs.tasks, costs.reused), (6, 4));
    assert_ne!(digest_of(&more), digest_of(&whole));
    assert_eq!(more.atlases.len(), 2, "{:?}", more.atlases);
    std::fs::remove_dir_all(&root).unwrap();
}

/// Every so many images below a folder.
fn images(folder: &Path, every: usize) -> Vec<PathBuf> {
    let mut below = vec![folder.to_owned()];
    let mut found = Vec::new();
    while let Some(entries) = below.pop().and_then(|folder| std::fs::read_dir(folder).ok()) {
        for path in entries.flatten().map(|e| e.path()) {
            let name = path.file_name().unwrap_or_default().to_string_lossy().to_string();
            if path.is_dir() && !name.contains("depth") {
                below.push(path);
            } else if !name.contains("depth") && (name.ends_with(".png") || name.ends_with(".jpg")) {
                found.push(path);
            }
        }
    }
    found.sort();
    found.into_iter().step_by(every).collect()
}

/// How many landmarks each image shows, and whether that is a place.
fn seen(store: &Path, images: &[PathBuf]) -> Vec<(usize, bool)> {
    let store = open(store.to_str().unwrap()).unwrap();
    let one = |image: &PathBuf| match fetch(&*store, &query_of(image.to_str().unwrap()).unwrap()).unwrap() {
        Answer::Place(Fetched { evidence: Evidence::Seen(seen), .. }, _) => (seen.landmarks, true),
        Answer::Unknown(Some(Evidence::Seen(seen))) => (seen.landmarks, false),
        Answer::Unknown(None) => (0, false),
        other => panic!("{other:?}"),
    };
    let mut all: Vec<_> = images.iter().map(one).collect();
    all.sort_unstable();
    all
}

/// Single images of walks of two houses, of places that are in the atlas and in none: rendered, and of real recordings where they are.
#[test]
fn an_unknown_place_is_said_to_be_unknown() {
    let root = folder("unknown");
    let (from, store) = (root.join("recordings"), root.join("store"));
    record(&from.join("a"), 11, "start=0&duration=12&height=1.3");
    record(&from.join("b"), 12, "start=0&duration=12&height=1.3");
    let job = Job { tile_m: 6.0, margin_m: 2.0, ..Job::new(from.to_str().unwrap(), store.to_str().unwrap()) };
    drive(&job, |job, task| run(job, task).unwrap());
    let (mut known, mut unknown) = (Vec::new(), Vec::new());
    for seed in [11, 12] {
        let walk = root.join(format!("again-{seed}"));
        record(&walk, seed, "start=1&duration=8&speed=1.1&height=1.4");
        known.extend(images(&walk, 4));
    }
    for seed in 71..77 {
        let walk = root.join(format!("elsewhere-{seed}"));
        record(&walk, seed, "start=1&duration=6&height=1.35");
        unknown.extend(images(&walk, 4));
    }
    let data = std::env::var_os("CAIRN_DATA").map_or_else(|| "../../../shared/data".into(), PathBuf::from);
    for (name, every) in
        [("7scenes-kitchen", 10), ("photos", 1), ("atrium", 40), ("house", 40), ("kitti-a", 10)]
    {
        unknown.extend(images(&data.join(name), every));
    }
    let (known, unknown) = (seen(&store, &known), seen(&store, &unknown));
    println!("known {known:?}\nunknown {unknown:?}");
    let places = known.iter().filter(|(_, place)| *place).count();
    println!("{places} of {} known, {} of others", known.len(), unknown.len());
    assert!(unknown.iter().all(|(_, place)| !place), "{unknown:?}");
    assert!(20 * places >= 19 * known.len(), "{places} of {}", known.len());
    std::fs::remove_dir_all(&root).unwrap();
}

#[test]
fn damage_and_wrong_addresses_are_told() {
    let root = folder("damage");
    let from = root.join("recordings");
    record(&from.join("a"), 11, "start=0&duration=3");
    let job = Job::new(from.to_str().unwrap(), root.join("store").to_str().unwrap());
    let report = drive(&job, |job, task| run(job, task).unwrap());
    assert_eq!(report.atlases, [[["a"]]]);
    let task = Task::Map { recording: "a".into() };
    let StepResult::Mapped(mapped) = run(&job, &task).unwrap().result else { panic!("it was mapped") };
    let digest = mapped.map.digest.to_string();
    let blob = root.join("store/blobs").join(&digest[..2]).join(&digest);
    let mut bytes = std::fs::read(&blob).unwrap();
    bytes[100] ^= 1;
    std::fs::write(&blob, &bytes).unwrap();
    let other = Job { tile_m: 5.0, ..job.clone() };
    let error = run(&other, &Task::Tiles { atlas: mapped.map.digest }).unwrap_err().to_string();
    assert!(error.contains("not what its name says"), "{error}");
    let wrong = |job: Job| Build::new(job).err().unwrap().to_string();
    assert!(wrong(Job { tile_m: 0.0, ..job.clone() }).contains("no size"));
    assert!(wrong(Job { shards: 0, ..job.clone() }).contains("shards"));
    assert!(wrong(Job { config: "nonsense = 3".into(), ..job.clone() }).contains("nonsense"));
    let nowhere = Job { recordings: root.join("nowhere").to_str().unwrap().into(), ..job.clone() };
    assert!(Build::new(nowhere).unwrap().next(Vec::new()).is_err());
    assert!(open("ftp://host/x").err().unwrap().to_string().contains("ftp"));
    #[cfg(not(feature = "s3"))]
    assert!(open("s3://bucket/x").err().unwrap().to_string().contains("--features s3"));
    let empty = open(root.join("none").to_str().unwrap()).unwrap();
    let query = query_of(from.join("a").to_str().unwrap()).unwrap();
    assert!(fetch(&*empty, &query).err().unwrap().to_string().contains("nothing was published"));
    std::fs::remove_dir_all(&root).unwrap();
}
