//! No struct has more than twenty fields, settings, arguments and messages aside: a type that knows more than that has a second purpose.
//!
//! Settings derive `Settings`, arguments `Args` or `Parser`, messages `Serialize`; generated and test code is left out.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use syn::{Attribute, Item};

const MOST: usize = 20;

/// Structs that are still larger, with their number of fields. The list only gets shorter, and its numbers smaller.
const LARGER: &[(&str, usize)] = &[
    ("cli/demo/phone/page.rs Page", 21),
    ("session/session.rs Session", 32),
    ("trial/robot/pilot/mod.rs Pilot", 32),
    ("trial/robot/run.rs End", 21),
    ("web/hub.rs Hub", 23),
];

/// Whether a type is made of what people or other programs write or read.
fn is_message(attributes: &[Attribute]) -> bool {
    let mut is_message = false;
    for attribute in attributes.iter().filter(|a| a.path().is_ident("derive")) {
        let _ = attribute.parse_nested_meta(|derived| {
            let name = derived.path.segments.last().map(|s| s.ident.to_string()).unwrap_or_default();
            is_message |= ["Args", "Deserialize", "Parser", "Serialize", "Settings"].contains(&name.as_str());
            Ok(())
        });
    }
    is_message
}

/// Structs among items and in the inline modules below them, with their numbers of fields.
fn structs(items: &[Item], found: &mut Vec<(String, usize)>) {
    for item in items {
        match item {
            Item::Struct(s) if !is_message(&s.attrs) => found.push((s.ident.to_string(), s.fields.len())),
            Item::Mod(m) => structs(m.content.as_ref().map_or(&[], |(_, items)| items), found),
            _ => {}
        }
    }
}

fn sources(folder: &Path, out: &mut Vec<PathBuf>) {
    for path in folder.read_dir().into_iter().flatten().map(|e| e.expect("an entry").path()) {
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        if name == "tests" || name.ends_with("_tests") {
            continue;
        }
        if path.is_dir() {
            sources(&path, out);
        } else if path.extension().is_some_and(|e| e == "rs") {
            out.push(path);
        }
    }
}

#[test]
fn no_struct_has_more_than_twenty_fields() {
    let crates = Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the folder of crates");
    let mut larger = BTreeMap::new();
    let mut counted = 0;
    for entry in crates.read_dir().expect("the folder of crates") {
        let folder = entry.expect("an entry").path();
        let name = folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let mut files = Vec::new();
        sources(&folder.join("src"), &mut files);
        for file in files {
            let text = std::fs::read_to_string(&file).expect("a source file");
            let parsed = syn::parse_file(&text).unwrap_or_else(|e| panic!("{}: {e}", file.display()));
            let mut found = Vec::new();
            structs(&parsed.items, &mut found);
            counted += found.len();
            let below = file.strip_prefix(folder.join("src")).expect("below the sources").display();
            for (one, fields) in found.into_iter().filter(|(_, fields)| *fields > MOST) {
                larger.insert(format!("{name}/{below} {one}"), fields);
            }
        }
    }
    assert!(counted > 1000, "only {counted} structs were found");
    let known: BTreeMap<String, usize> = LARGER.iter().map(|(name, n)| ((*name).to_owned(), *n)).collect();
    assert_eq!(larger, known, "structs of more than {MOST} fields (left), and those that are known (right)");
}

#[test]
fn fields_of_a_struct_are_counted_but_for_messages() {
    let parsed = syn::parse_file(
        "struct A { a: u8, b: u8 } mod inner { struct B(u8, u8, u8); } #[derive(Clone, serde::Serialize)] struct C { a: u8 }",
    );
    let mut found = Vec::new();
    structs(&parsed.expect("Rust").items, &mut found);
    assert_eq!(found, [("A".to_owned(), 2), ("B".to_owned(), 3)]);
}
