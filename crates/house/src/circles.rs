//! No circle of files inside a crate: a file uses others that do not use it, however far around.
//!
//! What a file uses is read from its `use` items and paths (`crate::`, `super::`, `self::`), tests left out. A name that a module
//! passes on (`pub use`) counts as that of the file that has it. What a file uses of the folder's own `mod.rs` does not count: a folder is
//! one module, told in several files.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use syn::visit::Visit;
use syn::{Attribute, Item, ItemMod, ItemUse, UseTree, Visibility};

/// A module path inside a crate; empty for the root.
type Module = Vec<String>;

/// A path that a file uses, and whether it passes the name on.
struct Use {
    path: Vec<String>,
    public: bool,
    /// How many inline modules of the file it stands in.
    inline: usize,
}

#[derive(Default)]
struct Uses {
    found: Vec<Use>,
    inline: usize,
}

fn only_for_tests(attributes: &[Attribute]) -> bool {
    attributes.iter().any(|a| {
        a.path().is_ident("cfg")
            && a.parse_args::<syn::Path>().is_ok_and(|condition| condition.is_ident("test"))
    })
}

impl Uses {
    fn tree(&mut self, before: &[String], tree: &UseTree, public: bool) {
        let with = |name: &syn::Ident| [before, &[name.to_string()]].concat();
        match tree {
            UseTree::Path(p) => self.tree(&with(&p.ident), &p.tree, public),
            UseTree::Name(n) => self.push(with(&n.ident), public),
            UseTree::Rename(r) => self.push(with(&r.ident), public),
            UseTree::Glob(_) => self.push([before, &["*".into()]].concat(), public),
            UseTree::Group(g) => g.items.iter().for_each(|t| self.tree(before, t, public)),
        }
    }

    fn push(&mut self, path: Vec<String>, public: bool) {
        self.found.push(Use { path, public, inline: self.inline });
    }
}

impl<'a> Visit<'a> for Uses {
    fn visit_item(&mut self, item: &'a Item) {
        let attributes = match item {
            Item::Mod(i) => &i.attrs,
            Item::Fn(i) => &i.attrs,
            Item::Impl(i) => &i.attrs,
            Item::Use(i) => &i.attrs,
            Item::Struct(i) => &i.attrs,
            _ => return syn::visit::visit_item(self, item),
        };
        if !only_for_tests(attributes) {
            syn::visit::visit_item(self, item);
        }
    }

    fn visit_item_mod(&mut self, module: &'a ItemMod) {
        self.inline += 1;
        syn::visit::visit_item_mod(self, module);
        self.inline -= 1;
    }

    fn visit_item_use(&mut self, item: &'a ItemUse) {
        self.tree(&[], &item.tree, !matches!(item.vis, Visibility::Inherited));
    }

    fn visit_path(&mut self, path: &'a syn::Path) {
        let names: Vec<String> = path.segments.iter().map(|s| s.ident.to_string()).collect();
        if names.len() > 1 {
            self.push(names, false);
        }
        syn::visit::visit_path(self, path);
    }
}

fn rust_files(folder: &Path, out: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).expect("a folder of sources").map(|e| e.expect("an entry").path())
    {
        if entry.is_dir() {
            rust_files(&entry, out);
        } else if entry.extension().is_some_and(|e| e == "rs") {
            out.push(entry);
        }
    }
}

/// The modules of a crate with what each uses; modules of tests are left out.
fn modules(src: &Path) -> BTreeMap<Module, Uses> {
    let mut files = Vec::new();
    rust_files(src, &mut files);
    let mut out = BTreeMap::new();
    for file in files {
        let below = file.strip_prefix(src).expect("below the sources").with_extension("");
        let mut module: Module = below.iter().map(|p| p.to_string_lossy().into_owned()).collect();
        if module.last().is_some_and(|last| ["lib", "main", "mod"].contains(&last.as_str())) {
            module.pop();
        }
        if module.iter().any(|part| part == "tests" || part.ends_with("_tests")) {
            continue;
        }
        let text = std::fs::read_to_string(&file).expect("a source file");
        let parsed = syn::parse_file(&text).unwrap_or_else(|e| panic!("{}: {e}", file.display()));
        let mut uses = Uses::default();
        uses.visit_file(&parsed);
        out.insert(module, uses);
    }
    out
}

/// The module that a path leads to, seen from `from`, and the name in it.
fn resolve(all: &BTreeMap<Module, Uses>, from: &Module, found: &Use) -> Option<(Module, Option<String>)> {
    let mut path = found.path.iter().peekable();
    let mut base = from.clone();
    match found.path[0].as_str() {
        "crate" => base.clear(),
        "self" => {}
        "super" => {
            let supers = found.path.iter().take_while(|p| *p == "super").count();
            base.truncate(base.len().saturating_sub(supers.saturating_sub(found.inline)));
        }
        first => {
            base.push(first.into());
            all.contains_key(&base).then_some(())?;
            base.pop();
        }
    }
    while path.next_if(|p| ["crate", "self", "super"].contains(&p.as_str())).is_some() {}
    while let Some(next) = path.peek() {
        base.push((*next).clone());
        if !all.contains_key(&base) {
            base.pop();
            break;
        }
        path.next();
    }
    Some((base, path.next().cloned()))
}

/// For each module those that it uses.
fn graph(all: &BTreeMap<Module, Uses>) -> BTreeMap<Module, BTreeSet<Module>> {
    let uses = || all.iter().flat_map(|(module, uses)| uses.found.iter().map(move |u| (module, u)));
    let mut passed_on = BTreeMap::new();
    for (module, found) in uses().filter(|(_, u)| u.public) {
        if let Some((base, Some(name))) = resolve(all, module, found).filter(|(base, _)| base != module) {
            passed_on.insert((module.clone(), name), base);
        }
    }
    let mut graph: BTreeMap<Module, BTreeSet<Module>> = BTreeMap::new();
    for (module, found) in uses() {
        let Some((mut base, name)) = resolve(all, module, found) else { continue };
        let mut seen = BTreeSet::new();
        while let Some(next) = name.as_ref().and_then(|n| passed_on.get(&(base.clone(), n.clone())))
            && seen.insert(base.clone())
        {
            base = next.clone();
        }
        let passes_on_its_own = found.public && base.starts_with(module);
        if !module.starts_with(&base) && !passes_on_its_own {
            graph.entry(module.clone()).or_default().insert(base);
        }
    }
    graph
}

/// A way from a module back to itself, where there is one.
fn circle(graph: &BTreeMap<Module, BTreeSet<Module>>) -> Option<Vec<Module>> {
    graph.keys().find_map(|start| {
        let mut came_from: BTreeMap<&Module, &Module> = BTreeMap::new();
        let mut open = vec![start];
        while let Some(at) = open.pop() {
            for next in graph.get(at).into_iter().flatten() {
                if next == start {
                    let mut way = vec![at.clone()];
                    while let Some(before) =
                        came_from.get(&way[way.len() - 1]).filter(|_| way[way.len() - 1] != *start)
                    {
                        way.push((*before).clone());
                    }
                    way.reverse();
                    return Some(way);
                }
                if !came_from.contains_key(next) {
                    came_from.insert(next, at);
                    open.push(next);
                }
            }
        }
        None
    })
}

#[test]
fn no_crate_has_a_circle_of_files() {
    let crates = Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the folder of crates");
    let mut circles = Vec::new();
    for entry in std::fs::read_dir(crates).expect("the folder of crates") {
        let folder = entry.expect("an entry").path();
        if folder.join("src").is_dir()
            && let Some(way) = circle(&graph(&modules(&folder.join("src"))))
        {
            let names: Vec<String> = way.iter().map(|m| m.join("/")).collect();
            let name = folder.file_name().unwrap_or_default().to_string_lossy();
            circles.push(format!("{name}: {} and back", names.join(" -> ")));
        }
    }
    assert!(circles.is_empty(), "circles of files:\n{}", circles.join("\n"));
}

#[test]
fn a_circle_is_found_through_a_name_passed_on() {
    let uses = |lines: &str| {
        let mut uses = Uses::default();
        uses.visit_file(&syn::parse_file(lines).expect("Rust"));
        uses
    };
    let module = |name: &str| vec![name.to_owned()];
    let mut all = BTreeMap::from([
        (vec![], uses("pub use b::Thing; mod a; mod b;")),
        (module("a"), uses("use crate::Thing; pub struct Other;")),
        (module("b"), uses("pub struct Thing; #[cfg(test)] mod tests { use crate::a::Other; }")),
    ]);
    assert_eq!(circle(&graph(&all)), None);
    all.insert(module("b"), uses("pub struct Thing(super::a::Other);"));
    assert_eq!(circle(&graph(&all)), Some(vec![module("a"), module("b")]));
}
