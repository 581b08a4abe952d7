//! Saving when the process is killed or the disk is full: the previous file can still be loaded.
//!
//! The processes that are killed and those that run out of room are this test program itself, started with
//! the name of one ignored test and the path to save to.

use crate::store::history::{Dice, described, file};
use cairn_atlas::store::MapFile;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

const TARGET: &str = "CAIRN_TEST_SAVE_TO";

fn folder(name: &str) -> PathBuf {
    let path = std::env::temp_dir().join(format!("cairn-atlas-saving-{}-{name}", std::process::id()));
    let _ = std::fs::remove_dir_all(&path);
    std::fs::create_dir_all(&path).unwrap();
    path
}

/// File number `n` of those saved in a loop.
fn numbered(n: u64) -> MapFile {
    let mut saved = file(n % 3, 40, 60);
    saved.attached.insert("number".into(), n.to_le_bytes().into());
    saved
}

fn number(file: &MapFile) -> u64 {
    u64::from_le_bytes(file.attached["number"][..].try_into().unwrap())
}

fn this_test(name: &str) -> Vec<String> {
    let program = std::env::current_exe().unwrap().display().to_string();
    [&program, name, "--exact", "--ignored", "--nocapture", "--test-threads=1"].map(String::from).into()
}

/// The child that is killed: it signals before its first save, then saves in a loop.
#[test]
#[ignore = "started by others of this file"]
fn child_saves_in_a_loop() {
    let Some(path) = std::env::var_os(TARGET) else { return };
    let files: Vec<MapFile> = (0..3).map(numbered).collect();
    std::fs::write(Path::new(&path).with_extension("ready"), "").unwrap();
    for n in 0.. {
        let mut next = files[n as usize % 3].clone();
        next.attached.insert("number".into(), (n as u64).to_le_bytes().into());
        next.save(Path::new(&path)).unwrap();
    }
}

#[test]
fn killed_process_leaves_a_loadable_file() {
    let folder = folder("kill");
    let path = folder.join("a.map");
    let ready = path.with_extension("ready");
    let expected: Vec<String> = (0..3).map(|n| described(&numbered(n).snapshot)).collect();
    let mut dice = Dice::new(11);
    let (mut left, mut saves) = (0, 0);
    for round in 0..50 {
        let child = this_test("store::saving::child_saves_in_a_loop");
        let mut child = Command::new(&child[0])
            .args(&child[1..])
            .env(TARGET, &path)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        while !(ready.exists() && (path.exists() || round > 0)) {
            std::thread::sleep(Duration::from_millis(1));
            assert!(child.try_wait().unwrap().is_none(), "the child ended by itself");
        }
        std::thread::sleep(Duration::from_micros(dice.roll(40_000) as u64));
        child.kill().unwrap();
        child.wait().unwrap();
        std::fs::remove_file(&ready).unwrap();
        let opened = MapFile::load(&path).unwrap_or_else(|e| panic!("killed in round {round}: {e}"));
        assert!(
            described(&opened.snapshot) == expected[number(&opened) as usize % 3],
            "another map was opened"
        );
        saves += number(&opened);
        left += other_files(&folder);
    }
    println!("killed 50 times after {saves} complete saves, {left} times with a file half written");
    assert!(left >= 5, "killed only {left} times while it was writing: too few to test anything");
    numbered(0).save(&path).unwrap();
    assert_eq!(other_files(&folder), 0, "files left behind are still there");
    std::fs::remove_dir_all(&folder).unwrap();
}

/// Files in the folder besides the map.
fn other_files(folder: &Path) -> usize {
    std::fs::read_dir(folder).unwrap().count() - 1
}

/// The child without room: the save fails, with a clear error.
#[test]
#[ignore = "started by others of this file"]
fn child_has_no_room() {
    let Some(path) = std::env::var_os(TARGET) else { return };
    let error = numbered(1).save(Path::new(&path)).expect_err("there was room");
    println!("told: {error}");
}

/// Runs a shell line in which `"$@"` saves; returns the error message, and what the line printed after it if
/// it succeeded.
fn without_room(line: &str, path: &Path) -> Option<(String, Option<String>)> {
    let output = Command::new("sh")
        .args(["-c", line, "sh"])
        .args(this_test("store::saving::child_has_no_room"))
        .env(TARGET, path)
        .env("FOLDER", path.parent().unwrap())
        .output()
        .ok()?;
    let text = String::from_utf8_lossy(&output.stdout);
    let message = text.lines().find_map(|l| l.split_once("told: "))?.1.to_owned();
    let after = text.rsplit_once("test result").map(|(_, after)| after.to_owned());
    Some((message, after.filter(|_| output.status.success())))
}

#[cfg(unix)]
#[test]
fn file_size_limit_keeps_the_previous_file() {
    let folder = folder("room");
    let path = folder.join("a.map");
    numbered(0).save(&path).unwrap();
    let before = std::fs::read(&path).unwrap();
    // Files of at most 16 blocks of 512 or 1024 bytes; the signal that comes with it is ignored.
    let (message, _) =
        without_room("trap '' XFSZ; ulimit -f 16; exec \"$@\"", &path).expect("an error is reported");
    assert!(message.contains("a.map: cannot write") && message.contains("File too large"), "{message}");
    assert_eq!(std::fs::read(&path).unwrap(), before);
    assert_eq!(other_files(&folder), 0, "a half-written file stayed");
    std::fs::remove_dir_all(&folder).unwrap();
}

#[cfg(target_os = "linux")]
#[test]
fn full_disk_keeps_the_previous_file() {
    let folder = folder("disk");
    let path = folder.join("a.map");
    numbered(0).save(&path).unwrap();
    let before = std::fs::metadata(&path).unwrap().len();
    // A separate file system with room for one and a half maps, inspected from inside.
    let line = format!(
        "exec unshare -rm sh -c 'cp \"$FOLDER/a.map\" \"$FOLDER.copy\" && mount -t tmpfs -o size={}k none \"$FOLDER\" && \
         cp \"$FOLDER.copy\" \"$FOLDER/a.map\" && \"$@\" && cmp \"$FOLDER.copy\" \"$FOLDER/a.map\" && echo \"only $(ls -A \"$FOLDER\")\"' sh \"$@\"",
        before * 3 / 2 / 1024
    );
    let outcome = without_room(&line, &path);
    let _ = std::fs::remove_file(folder.with_extension("copy"));
    match outcome {
        Some((message, after)) => {
            assert!(
                message.contains("a.map: cannot write") && message.contains("No space left"),
                "{message}"
            );
            let after = after.expect("the previous file is unchanged");
            assert_eq!(after.trim_end().lines().last(), Some("only a.map"), "{after}");
        }
        None => println!("skipped: a separate file system cannot be mounted here"),
    }
    std::fs::remove_dir_all(&folder).unwrap();
}
