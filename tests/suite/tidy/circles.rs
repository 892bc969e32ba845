//! No two files import from each other, directly or through others. Checked are the imports at the top level of each file.
//!
//! A file and the files of its folder count as one: what `a.rs` defines may be used in `a/b.rs`, and the other way round. An import
//! through a re-export counts as an import from the file that defines the name.

use super::style::circle;
use super::{CRATES, module_path, project, read, rust_files, source};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// The names that a file defines and imports.
#[derive(Default)]
struct Module {
    defined: BTreeSet<String>,
    /// Full path of each import as it is written, without `as`.
    imports: Vec<Vec<String>>,
}

/// Modules by path: `["clusters", "tree"]`; the crate's root is the empty path.
type Modules = BTreeMap<Vec<String>, Module>;

fn is_test(attributes: &[syn::Attribute]) -> bool {
    attributes.iter().any(|a| {
        a.path().is_ident("cfg") && a.parse_args::<syn::Ident>().is_ok_and(|condition| condition == "test")
    })
}

fn module(text: &str) -> Module {
    let mut module = Module::default();
    for item in syn::parse_file(text).expect("a Rust file").items {
        use syn::Item;
        let (attributes, name) = match item {
            Item::Const(i) => (i.attrs, i.ident),
            Item::Enum(i) => (i.attrs, i.ident),
            Item::Fn(i) => (i.attrs, i.sig.ident),
            Item::Static(i) => (i.attrs, i.ident),
            Item::Struct(i) => (i.attrs, i.ident),
            Item::Trait(i) => (i.attrs, i.ident),
            Item::Type(i) => (i.attrs, i.ident),
            Item::Use(i) if !is_test(&i.attrs) => {
                imports(&i.tree, &mut Vec::new(), &mut module.imports);
                continue;
            }
            _ => continue,
        };
        if !is_test(&attributes) {
            module.defined.insert(name.to_string());
        }
    }
    module
}

/// Adds the paths of an import to `found`.
fn imports(tree: &syn::UseTree, path: &mut Vec<String>, found: &mut Vec<Vec<String>>) {
    let last = match tree {
        syn::UseTree::Path(part) => {
            path.push(part.ident.to_string());
            imports(&part.tree, path, found);
            path.pop();
            return;
        }
        syn::UseTree::Group(group) => {
            group.items.iter().for_each(|tree| imports(tree, path, found));
            return;
        }
        syn::UseTree::Name(name) => name.ident.to_string(),
        syn::UseTree::Rename(name) => name.ident.to_string(),
        syn::UseTree::Glob(_) => "*".to_owned(),
    };
    found.push([&path[..], &[last]].concat());
}

/// Adds the names that these items and the modules among them export.
pub(super) fn exports(items: &[syn::Item], found: &mut Vec<String>) {
    for item in items {
        match item {
            syn::Item::Use(item) if matches!(item.vis, syn::Visibility::Public(_)) => {
                let mut paths = Vec::new();
                imports(&item.tree, &mut Vec::new(), &mut paths);
                found.extend(paths.into_iter().filter_map(|mut path| path.pop()));
            }
            syn::Item::Mod(module) => exports(module.content.as_ref().map_or(&[], |(_, items)| items), found),
            _ => {}
        }
    }
}

/// The module that defines what `path` names in `from`; none for other crates.
fn definer(modules: &Modules, from: &[String], path: &[String], depth: usize) -> Option<Vec<String>> {
    let ups = path.iter().take_while(|p| *p == "super").count();
    let (mut at, mut rest) = match path[0].as_str() {
        "crate" => (Vec::new(), &path[1..]),
        "self" => (from.to_vec(), &path[1..]),
        "super" => (from[..from.len() - ups].to_vec(), &path[ups..]),
        _ => (from.to_vec(), path),
    };
    let begin = at.len();
    while let Some(name) = rest.first() {
        let inner = [&at[..], std::slice::from_ref(name)].concat();
        if !modules.contains_key(&inner) {
            break;
        }
        (at, rest) = (inner, &rest[1..]);
    }
    let foreign = !["crate", "self", "super"].contains(&path[0].as_str()) && at.len() == begin;
    let module = modules.get(&at).filter(|_| !foreign)?;
    let Some(name) = rest.first() else { return Some(at) };
    let exported = (!module.defined.contains(name) && depth > 0)
        .then(|| module.imports.iter().filter(|p| p.last() == Some(name) && p[..] != *path))
        .into_iter()
        .flatten()
        .find_map(|p| definer(modules, &at, p, depth - 1));
    exported.or(Some(at))
}

/// By file, the files that it imports from.
fn graph(modules: &Modules) -> BTreeMap<String, BTreeSet<String>> {
    /// Re-exports of re-exports that are followed.
    const MAX_DEPTH: usize = 5;
    let name = |path: &[String]| path.join("::");
    modules
        .iter()
        .map(|(path, module)| {
            let definers = module.imports.iter().filter_map(|p| definer(modules, path, p, MAX_DEPTH));
            let others = definers.filter(|to| !path.starts_with(to) && !to.starts_with(path));
            (name(path), others.map(|to| name(&to)).collect())
        })
        .collect()
}

fn find(graph: &BTreeMap<String, BTreeSet<String>>) -> Option<Vec<&str>> {
    let mut done = BTreeSet::new();
    graph.keys().find_map(|file| circle(graph, file, &mut Vec::new(), &mut done))
}

fn of_source(root: &Path) -> Modules {
    let is_test =
        |path: &[String]| path.iter().any(|part| ["tests", "testing", "main"].contains(&part.as_str()));
    rust_files(root)
        .iter()
        .map(|file| {
            let mut path = module_path(root, file);
            path.pop_if(|last| last == "lib");
            (path, file)
        })
        .filter(|(path, _)| !is_test(path))
        .map(|(path, file)| (path, module(&read(file))))
        .collect()
}

#[test]
fn files_do_not_import_each_other_in_circles() {
    let graph = graph(&of_source(&source()));
    assert!(graph.values().map(BTreeSet::len).sum::<usize>() > 500, "imports are found");
    assert_eq!(find(&graph), None, "a circle of imports");
    for folder in &CRATES[1..] {
        let graph = self::graph(&of_source(&project(folder)));
        assert_eq!(find(&graph), None, "a circle of imports in {folder}");
    }
}

#[test]
fn circles_are_found_through_exports() {
    let of =
        |path: &str, text: &str| (path.split_terminator("::").map(str::to_owned).collect(), module(text));
    let mut modules = Modules::from([
        of("", "pub use a::b::B;"),
        of("a", "mod b; mod c; pub use c::{C, D as E};"),
        of("a::b", "use super::C; use std::fmt; pub struct B;"),
        of("a::c", "use crate::d::thing; pub struct C; pub struct D;"),
        of("d", "#[cfg(test)] use crate::B; pub fn thing() {}"),
    ]);
    assert_eq!(find(&graph(&modules)), None);
    modules.extend([of("d", "use crate::{B, a}; pub fn thing() {}")]);
    assert_eq!(find(&graph(&modules)), Some(vec!["a::b", "a::c", "d", "a::b"]));
}
