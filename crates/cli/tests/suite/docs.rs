//! The documents: links lead somewhere, commands and their options exist, every page is in the book.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;

fn root() -> PathBuf {
    PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
}

/// All pages that people read: those of the root, of docs/ and of each crate.
fn pages() -> BTreeMap<PathBuf, String> {
    let mut folders = vec![root(), root().join("docs"), root().join("docs/guides")];
    folders.extend(root().join("crates").read_dir().unwrap().map(|e| e.unwrap().path()));
    let files = folders.iter().flat_map(|f| f.read_dir().into_iter().flatten()).map(|e| e.unwrap().path());
    files
        .filter(|p| p.extension().is_some_and(|e| e == "md"))
        .map(|p| (p.clone(), std::fs::read_to_string(&p).unwrap()))
        .collect()
}

#[test]
fn links_lead_to_files_that_exist() {
    let mut broken = Vec::new();
    let mut checked = 0;
    for (page, text) in pages() {
        for link in text.split("](").skip(1).filter_map(|rest| rest.split(')').next()) {
            let file = link.split('#').next().unwrap_or_default();
            if file.is_empty() || file.contains("://") || file.contains(' ') {
                continue;
            }
            checked += 1;
            // The book holds what is in docs/ and nothing else.
            let leaves_the_book = page.starts_with(root().join("docs")) && {
                let depth = page.strip_prefix(root().join("docs")).unwrap().components().count() - 1;
                file.split('/').filter(|part| *part == "..").count() > depth
            };
            if leaves_the_book || !page.parent().unwrap().join(file).exists() {
                broken.push(format!("{}: {link}", page.display()));
            }
        }
    }
    assert!(broken.is_empty(), "{broken:#?}");
    assert!(checked > 30, "only {checked} links were found");
}

#[test]
fn every_page_is_in_the_book() {
    let summary = std::fs::read_to_string(root().join("docs/SUMMARY.md")).unwrap();
    let listed: BTreeSet<&str> =
        summary.split("](").skip(1).filter_map(|rest| rest.split(')').next()).collect();
    for (page, _) in pages() {
        let Ok(name) = page.strip_prefix(root().join("docs")) else { continue };
        let name = name.to_str().unwrap();
        assert!(name == "SUMMARY.md" || listed.contains(name), "docs/{name} is not in docs/SUMMARY.md");
    }
}

/// The help of a command, by its words; empty where there is no such command.
fn help(words: &[&str], known: &mut BTreeMap<String, String>) -> String {
    let run = || {
        let output = Command::new(env!("CARGO_BIN_EXE_cairn")).args(words).arg("--help").output().unwrap();
        let text = String::from_utf8(output.stdout).unwrap();
        if output.status.success() { text } else { String::new() }
    };
    known.entry(words.join(" ")).or_insert_with(run).clone()
}

/// What is wrong with a command line (without the word cairn), if anything.
fn wrong(line: &str, known: &mut BTreeMap<String, String>) -> Option<String> {
    // In a table a bar is written as "\\|".
    let line = line.replace("\\|", "|");
    let words: Vec<&str> = line.split_whitespace().collect();
    let first = *words.first()?;
    if !first.chars().all(|c| c.is_ascii_lowercase()) {
        return None;
    }
    let mut path = vec![first];
    let mut text = help(&path, known);
    if text.is_empty() {
        return Some(format!("there is no cairn {first}"));
    }
    if let Some(second) = words.get(1).filter(|_| text.contains("<COMMAND>")) {
        // "map info|check" stands for several.
        for second in second.split('|') {
            path = vec![first, second];
            text = help(&path, known);
            if text.is_empty() {
                return Some(format!("there is no cairn {first} {second}"));
            }
        }
    }
    let options = words.iter().filter(|w| w.starts_with("--") && w.len() > 2);
    let names = options.map(|w| w.split(['=', ',', '`', ';', ')']).next().unwrap_or(w).trim_end_matches('.'));
    let absent = names.filter(|name| !text.split([' ', ',', '\n', '[', ']']).any(|word| word == *name));
    absent.map(|name| format!("cairn {} has no {name}", path.join(" "))).next()
}

#[test]
fn commands_and_options_in_the_documents_exist() {
    let mut known = BTreeMap::new();
    let mut broken = Vec::new();
    let mut checked = 0;
    let documents = pages().into_iter().filter(|(page, _)| !page.ends_with("CHANGELOG.md"));
    for (page, text) in documents {
        let mut fence = None;
        for line in text.lines() {
            if let Some(kind) = line.trim_start().strip_prefix("```") {
                fence = if fence.is_none() { Some(kind.to_owned()) } else { None };
                continue;
            }
            let commands: Vec<&str> = match fence.as_deref() {
                Some("sh" | "console") => vec![line.split(" # ").next().unwrap_or(line)],
                Some(_) => continue,
                None => line.split('`').skip(1).step_by(2).collect(),
            };
            for command in commands {
                let command = command.trim().trim_start_matches("$ ");
                let prefixes = ["cairn ", "cargo run --release -- "];
                let Some(rest) = prefixes.iter().find_map(|p| command.strip_prefix(p)) else { continue };
                checked += 1;
                if let Some(why) = wrong(rest, &mut known) {
                    broken.push(format!(
                        "{}: {command}: {why}",
                        Path::new(page.file_name().unwrap()).display()
                    ));
                }
            }
        }
    }
    assert!(broken.is_empty(), "{broken:#?}");
    assert!(checked > 60, "only {checked} commands were found");
}
