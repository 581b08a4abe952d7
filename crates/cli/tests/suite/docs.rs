//! The documents: links lead somewhere, commands, options and paths exist, every page is in the book, pages are short
//! and sentences are those of a native engineer.

use cairn_phrases::Language;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;

fn root() -> PathBuf {
    PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
}

/// The folders in a folder.
fn folders_in(folder: &Path) -> impl Iterator<Item = PathBuf> {
    folder.read_dir().unwrap().map(|e| e.unwrap().path()).filter(|p| p.is_dir())
}

/// All pages that people read: those of the root, of docs/ with its folders, and of each crate.
fn pages() -> BTreeMap<PathBuf, String> {
    let mut folders = vec![root(), root().join("docs")];
    folders.extend(folders_in(&root().join("docs")));
    folders.extend(folders_in(&root().join("crates")));
    let files = folders.iter().flat_map(|f| f.read_dir().unwrap()).map(|e| e.unwrap().path());
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

/// The text of all sources below a folder.
fn sources(folder: &Path, text: &mut String) {
    for path in folder.read_dir().unwrap().map(|e| e.unwrap().path()) {
        if path.is_dir() {
            sources(&path, text);
        } else if path.extension().is_some_and(|e| e == "rs") {
            text.push_str(&std::fs::read_to_string(&path).unwrap());
        }
    }
}

/// Each line of a table ends in the name of the test that holds it.
#[test]
fn tests_that_hold_what_happens_when_something_fails_exist() {
    let page = std::fs::read_to_string(root().join("docs/failures.md")).unwrap();
    let mut code = String::new();
    sources(&root().join("crates"), &mut code);
    let rows = page.lines().filter(|l| l.starts_with("| ") && !l.starts_with("| what fails"));
    let names: Vec<&str> = rows.map(|l| l.trim_end_matches([' ', '|']).rsplit(' ').next().unwrap()).collect();
    assert!(names.len() > 25, "{names:?}");
    for name in names {
        let function = format!("fn {}()", name.trim_matches('`'));
        assert!(name.starts_with('`') && code.contains(&function), "{name} is no test");
    }
}

/// Sentences are said by the guide, or by a script of the page; labels and table cells do not end in a full stop.
#[test]
fn every_sentence_names_its_hazard_and_a_test() {
    let read = |path: &str| std::fs::read_to_string(root().join(path)).unwrap();
    let page = read("docs/figures/sentences.md");
    let (mut scripts, mut code) = (String::new(), String::new());
    let files = root().join("crates/web/src/page").read_dir().unwrap().map(|e| e.unwrap().path());
    files
        .filter(|p| p.extension().is_some_and(|e| e == "js"))
        .for_each(|p| scripts += &std::fs::read_to_string(p).unwrap());
    sources(&root().join("crates"), &mut code);
    let words = |cell: &str| cell.split('`').skip(1).step_by(2).map(str::to_owned).collect::<Vec<_>>();
    let (mut listed, mut faults) = (BTreeMap::<String, usize>::new(), Vec::new());
    for row in page.lines().filter(|line| line.starts_with("| `")) {
        let cells: Vec<&str> = row.trim_matches('|').split('|').collect();
        let [ids, hazard, test] = cells[..] else { panic!("not three cells: {row}") };
        words(ids).into_iter().for_each(|id| *listed.entry(id).or_default() += 1);
        let test = words(test).concat();
        if hazard.trim().len() < 8 || !code.contains(&format!("fn {test}()")) {
            faults.push(format!("no hazard, or no such test: {hazard} {test}"));
        }
    }
    faults.extend(listed.iter().filter(|(_, n)| **n > 1).map(|(id, n)| format!("{id} has {n} rows")));
    let catalogue = read("crates/phrases/languages/en.ftl");
    let ids = catalogue.lines().filter_map(|line| Some(line.split_once(" = ")?.0));
    let ids: BTreeSet<&str> = ids.filter(|id| !id.contains([' ', '#'])).collect();
    let is_said = |id: &&str| {
        let text = Language::English.text(id);
        let is_sentence = text.trim_end().ends_with(['.', '?', '!']) || text.contains(". ");
        let by_script = ["'", "\"", "`"].iter().any(|quote| scripts.contains(&format!("{quote}{id}{quote}")));
        is_sentence && (!id.starts_with("page-") || by_script)
    };
    let said: Vec<&str> = ids.iter().copied().filter(is_said).collect();
    assert!(said.len() > 200, "{} sentences", said.len());
    faults.extend(said.iter().filter(|id| !listed.contains_key(**id)).map(|id| format!("{id} has no row")));
    faults.extend(listed.keys().filter(|id| !ids.contains(&id[..])).map(|id| format!("{id} is no sentence")));
    assert!(faults.is_empty(), "{faults:#?}");
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

/// The text of a page outside its code blocks, line by line.
fn lines_outside_code(text: &str) -> impl Iterator<Item = &str> {
    let mut in_code = false;
    text.lines().filter(move |line| {
        let is_fence = line.trim_start().starts_with("```");
        in_code ^= is_fence;
        !in_code && !is_fence
    })
}

/// A line with links as their texts, and each code span as one word.
fn plain(line: &str) -> String {
    let spans = line.split('`').enumerate().map(|(i, part)| if i % 2 == 1 { "Code" } else { part });
    let line: String = spans.collect();
    let mut out = String::new();
    let mut rest = line.as_str();
    while let Some(at) = rest.find("](") {
        out.push_str(&rest[..at]);
        rest = rest[at..].split_once(')').map_or("", |(_, after)| after);
    }
    out.push_str(rest);
    out.replace(['[', ']', '*', '_'], "")
}

/// The paragraphs and list items of a page: no code, tables, headings, comments or pictures.
fn paragraphs(text: &str) -> Vec<String> {
    let mut found = vec![String::new()];
    let mut in_code = false;
    for line in text.lines() {
        let line = line.trim_start();
        let is_fence = line.starts_with("```");
        in_code ^= is_fence;
        if in_code || is_fence || line.is_empty() || ["|", "#", "<", "!["].iter().any(|p| line.starts_with(p))
        {
            found.push(String::new());
            continue;
        }
        let number = line.trim_start_matches(|c: char| c.is_ascii_digit());
        let item = match line.strip_prefix("- ").or_else(|| line.strip_prefix("* ")) {
            None if number.len() < line.len() => number.strip_prefix(". "),
            item => item,
        };
        if item.is_some() {
            found.push(String::new());
        }
        let paragraph = found.last_mut().expect("never empty");
        paragraph.push_str(item.unwrap_or(line));
        paragraph.push(' ');
    }
    found.iter().map(|p| plain(p)).filter(|p| !p.trim().is_empty()).collect()
}

/// Abbreviations after which a sentence goes on.
const ABBREVIATIONS: [&str; 6] = ["e.g.", "i.e.", "vs.", "al.", "Fig.", "Eq."];

/// The sentences of a paragraph, each as its words.
fn sentences(paragraph: &str) -> Vec<Vec<&str>> {
    let mut found = vec![Vec::new()];
    let mut words = paragraph.split_whitespace().peekable();
    while let Some(word) = words.next() {
        if word.contains(char::is_alphanumeric) {
            found.last_mut().expect("never empty").push(word);
        }
        let bare = word.trim_end_matches([')', '"', '\'']);
        let ends = bare.ends_with(['.', '?', '!']) && !ABBREVIATIONS.contains(&bare.trim_start_matches('('));
        let next = words.peek().and_then(|next| next.chars().find(|c| c.is_alphanumeric()));
        if ends && next.is_some_and(|c| c.is_uppercase() || c.is_numeric()) {
            found.push(Vec::new());
        }
    }
    found.retain(|sentence| !sentence.is_empty());
    found
}

/// Words of the mean and of the longest sentence of a page.
const SENTENCE: (usize, usize) = (20, 40);

/// What a native engineer would not write, and what they would.
const BANNED: [(&str, &str); 22] = [
    ("who stands", "a walker who has stopped"),
    ("whoever", "anyone who, a walker who"),
    ("he", "they"),
    ("him", "them"),
    ("his", "their"),
    ("himself", "themselves"),
    ("is told", "is reported, is announced, hears"),
    ("are told", "are reported, are announced, hear"),
    ("was told", "was reported, was announced, heard"),
    ("has metres", "is metric"),
    ("have metres", "are metric"),
    ("without metres", "without metric scale"),
    ("to and fro", "back and forth"),
    ("in the mean", "on average"),
    ("in the median", "median"),
    ("in place of", "instead of"),
    ("in vain", "without success"),
    ("put right", "corrected"),
    ("all the same", "nevertheless"),
    ("of one's own", "of your own"),
    ("is of commit", "was measured at commit"),
    ("are of commit", "were measured at commit"),
];

/// What is wrong with the English of a page.
fn faults_of_english(text: &str) -> Vec<String> {
    let paragraphs = paragraphs(text);
    let sentences: Vec<Vec<&str>> = paragraphs.iter().flat_map(|p| sentences(p)).collect();
    let (mean, longest) = SENTENCE;
    let long = sentences.iter().filter(|s| s.len() > longest);
    let mut faults: Vec<String> =
        long.map(|s| format!("a sentence of {} words: {} ...", s.len(), s[..8].join(" "))).collect();
    let words: usize = sentences.iter().map(Vec::len).sum();
    if words > mean * sentences.len() {
        faults.push(format!("{words} words in {} sentences", sentences.len()));
    }
    let lines: Vec<String> = lines_outside_code(text).map(plain).collect();
    let text = lines.join(" ").to_lowercase();
    let words: Vec<&str> =
        text.split(|c: char| !c.is_alphanumeric() && c != '\'').filter(|w| !w.is_empty()).collect();
    for (phrase, better) in BANNED {
        let phrase: Vec<&str> = phrase.split(' ').collect();
        let at = words.windows(phrase.len()).position(|w| w == phrase);
        faults.extend(at.map(|at| {
            let near = &words[at.saturating_sub(4)..words.len().min(at + 6)];
            format!("\"{}\" in \"{}\": {better}", phrase.join(" "), near.join(" "))
        }));
    }
    faults
}

/// Words of a page of use, of a decision, and of a release in the changelog; bytes of the architecture page.
const WORDS_OF_USE: usize = 800;
const WORDS_OF_A_DECISION: usize = 400;
const WORDS_OF_A_RELEASE: usize = 300;
const BYTES_OF_ARCHITECTURE: usize = 15_000;

/// What is too long on a page, by its path from the root.
fn faults_of_size(page: &str, text: &str) -> Vec<String> {
    let most = |what: &str, is: usize, may: usize| (is > may).then(|| format!("{what}: {is}, at most {may}"));
    let words = |text: &str| text.split_whitespace().count();
    let folder = page.rsplit_once('/').map_or("", |(folder, _)| folder);
    match (folder, page) {
        ("", "ARCHITECTURE.md") => most("bytes", text.len(), BYTES_OF_ARCHITECTURE).into_iter().collect(),
        ("", "CHANGELOG.md") => {
            let releases =
                text.split("\n## ").skip(1).map(|release| release.split_once('\n').unwrap_or((release, "")));
            let faults = releases.flat_map(|(name, entries)| {
                let entry = |line: &str| line.is_empty() || line.starts_with("- ");
                let odd = if name == "Unreleased" { entries.lines().find(|line| !entry(line)) } else { None };
                let odd = odd.map(|line| format!("Unreleased has more than one line for an entry: {line}"));
                let size =
                    if name == "Unreleased" { None } else { most(name, words(entries), WORDS_OF_A_RELEASE) };
                odd.into_iter().chain(size)
            });
            faults.collect()
        }
        ("docs/decisions", _) => most("words", words(text), WORDS_OF_A_DECISION).into_iter().collect(),
        ("docs" | "docs/guides", _) => most("words", words(text), WORDS_OF_USE).into_iter().collect(),
        _ => Vec::new(),
    }
}

/// The faults of all pages, by a check of their path from the root and their text.
fn faults(check: impl Fn(&str, &str) -> Vec<String>) -> Vec<String> {
    let root = root();
    let named = pages().into_iter().map(|(page, text)| (page.strip_prefix(&root).unwrap().to_owned(), text));
    let faults = named.flat_map(|(page, text)| {
        let page = page.to_str().unwrap().to_owned();
        check(&page, &text).into_iter().map(move |fault| format!("{page}: {fault}"))
    });
    faults.collect()
}

#[test]
fn pages_are_in_plain_english() {
    let faults = faults(|_, text| faults_of_english(text));
    assert!(faults.is_empty(), "{faults:#?}");
}

#[test]
fn pages_are_short() {
    let faults = faults(faults_of_size);
    assert!(faults.is_empty(), "{faults:#?}");
}

/// Paths of the sources in code spans: from the root, from `crates/`, or from the page's own folder.
#[test]
fn paths_in_the_documents_exist() {
    let checked = std::cell::Cell::new(0);
    let faults = faults(|page, text| {
        let own = root().join(page);
        let bases = [root(), root().join("crates"), own.parent().unwrap().to_owned()];
        let spans = lines_outside_code(text).flat_map(|line| line.split('`').skip(1).step_by(2));
        let is_path = |span: &&str| {
            let sources = span.starts_with("crates/") || span.contains("/src/") || span.starts_with("docs/");
            sources && span.chars().all(|c| c.is_ascii_alphanumeric() || "/._-".contains(c))
        };
        let paths = spans.filter(is_path).inspect(|_| checked.set(checked.get() + 1));
        let absent = paths.filter(|path| bases.iter().all(|base| !base.join(path).exists()));
        absent.map(|path| format!("there is no {path}")).collect()
    });
    assert!(faults.is_empty(), "{faults:#?}");
    assert!(checked.get() > 30, "only {} paths were found", checked.get());
}

#[test]
fn bad_english_and_long_pages_are_faults() {
    let good = "# Title\n\nThe guide stops. It reports `a b c` (see [a page](x.md)).\n\n- One item\n- Another item\n";
    assert_eq!(faults_of_english(good), Vec::<String>::new());
    assert_eq!(sentences("One, e.g. This is one. 2 is another? yes, the same.").len(), 2);
    assert_eq!(
        paragraphs("One\nparagraph.\n1. first\n2. second\n| a | table |\n```sh\ncode\n```\nEnd.").len(),
        4
    );
    let long = format!("Short.{}.", " Word".repeat(41));
    assert_eq!(faults_of_english(&long).len(), 2, "longest and mean: {:?}", faults_of_english(&long));
    assert_eq!(
        faults_of_english(&long.replace('.', "\n\n").replace(" Word", "\n- Word")),
        Vec::<String>::new()
    );
    assert_eq!(faults_of_english("The walker is\ntold to stop.").len(), 1);
    assert_eq!(faults_of_english("| a | what he hears |").len(), 1);
    assert_eq!(faults_of_english("The `he` of `who stands` in the theory."), Vec::<String>::new());

    let words = |n: usize| "word ".repeat(n);
    assert_eq!(faults_of_size("docs/x.md", &words(801)).len(), 1);
    assert_eq!(faults_of_size("docs/guides/x.md", &words(800)).len(), 0);
    assert_eq!(faults_of_size("docs/figures/x.md", &words(5000)).len(), 0);
    assert_eq!(faults_of_size("docs/decisions/x.md", &words(401)).len(), 1);
    assert_eq!(faults_of_size("ARCHITECTURE.md", &words(3001)).len(), 1);
    let changes = format!("# Changelog\n\n## Unreleased\n\n- One.\n- Two.\n\n## 0.1.0\n\n{}", words(300));
    assert_eq!(faults_of_size("CHANGELOG.md", &changes), Vec::<String>::new());
    assert_eq!(faults_of_size("CHANGELOG.md", &format!("{changes} more")).len(), 1);
    assert_eq!(faults_of_size("CHANGELOG.md", &changes.replace("- Two", "  two")).len(), 1);
}
