//! The graph of modules: which file of a crate names items of which other file.
//!
//! A file depends on another if it names an item that the other one defines. A re-export (a "door" below) is
//! no dependency of its file: whoever uses it depends on the file with the definition. Tests do not count.

use std::collections::{BTreeMap, BTreeSet};
use std::slice;

use proc_macro2::{Delimiter, TokenStream, TokenTree};

use crate::source::{Source, assert_none, rust_sources};

/// Names from the crate's root, or from a module, to a module or an item.
type ItemPath = Vec<String>;

/// Keywords that are followed by the name of an item.
const DECLARATIONS: [&str; 9] =
    ["fn", "struct", "enum", "union", "trait", "const", "static", "type", "macro_rules"];
/// Longest chain of re-exports that is followed.
const MAX_DOORS: usize = 20;

/// A file: the items that it declares, and the paths that it names.
#[derive(Default)]
struct Module {
    file: String,
    /// Modules in files of their own.
    children: BTreeSet<String>,
    /// Children that are compiled for tests only.
    test_children: BTreeSet<String>,
    items: BTreeSet<String>,
    /// Names that `use` brings into the module, and what they stand for.
    imports: BTreeMap<String, ItemPath>,
    /// The names among them that are re-exported.
    doors: BTreeSet<String>,
    globs: Vec<ItemPath>,
    /// Paths in code, of one or more names.
    paths: BTreeSet<ItemPath>,
}

impl Module {
    fn read(source: &Source) -> Self {
        let tokens: TokenStream =
            source.text.parse().unwrap_or_else(|error| panic!("{}: {error}", source.path));
        let mut module = Self { file: source.path.clone(), ..Self::default() };
        module.scan(tokens, true);
        module
    }

    /// Reads a sequence of tokens. Items are declared at the top level only.
    fn scan(&mut self, tokens: TokenStream, is_top: bool) {
        let tokens: Vec<TokenTree> = tokens.into_iter().collect();
        let (mut at, mut is_test) = (0, false);
        while let Some(token) = tokens.get(at) {
            at += 1;
            match token {
                TokenTree::Group(group) if is_attribute(&tokens, at - 1) => {
                    is_test |= group.stream().to_string().replace(' ', "") == "cfg(test)";
                }
                TokenTree::Group(group) => {
                    if !is_test {
                        self.scan(group.stream(), false);
                    }
                    is_test &= group.delimiter() != Delimiter::Brace;
                }
                TokenTree::Ident(word) if *word == "use" => {
                    let length = tokens[at..].iter().position(|token| is_punct(token, ';')).unwrap_or(0);
                    if !std::mem::take(&mut is_test) {
                        self.import(&tokens[at..at + length], is_door(&tokens, at - 1));
                    }
                    at += length;
                }
                TokenTree::Ident(word) => {
                    let name = tokens.get(at).and_then(name);
                    let is_file = tokens.get(at + 1).is_some_and(|token| is_punct(token, ';'));
                    match name {
                        Some(name) if is_top && *word == "mod" && is_file => {
                            let tests = std::mem::take(&mut is_test);
                            (if tests { &mut self.test_children } else { &mut self.children }).insert(name);
                        }
                        Some(name) if is_top && DECLARATIONS.iter().any(|keyword| word == keyword) => {
                            self.items.insert(name);
                        }
                        _ => {
                            let path = path_at(&tokens, at - 1);
                            at += 3 * (path.len() - 1);
                            if !is_test {
                                self.paths.insert(path);
                            }
                        }
                    }
                }
                TokenTree::Punct(punct) => is_test &= punct.as_char() != ';',
                TokenTree::Literal(_) => {}
            }
        }
    }

    fn import(&mut self, tree: &[TokenTree], is_door: bool) {
        let (mut named, mut globs) = (Vec::new(), Vec::new());
        flatten(&[], tree, &mut named, &mut globs);
        if is_door {
            self.doors.extend(named.iter().map(|(name, _)| name.clone()));
        }
        self.imports.extend(named);
        self.globs.extend(globs);
    }

    /// Returns the paths on which the file itself depends.
    fn dependencies(&self) -> impl Iterator<Item = &ItemPath> {
        let is_named = |name: &String| self.paths.iter().any(|path| path[0] == *name);
        let imports =
            self.imports.iter().filter(move |(name, _)| !self.doors.contains(*name) || is_named(name));
        self.paths.iter().filter(|path| path.len() > 1).chain(imports.map(|(_, path)| path))
    }
}

/// The modules of a crate, by their paths.
struct Crate(BTreeMap<ItemPath, Module>);

impl Crate {
    /// Returns the file that defines what `path` names in `module`, if it belongs to this crate.
    fn definition(&self, module: &[String], path: &[String], n_doors: usize) -> Option<&str> {
        let own = self.0.get(module).filter(|_| n_doors < MAX_DOORS)?;
        let (first, rest) = path.split_first()?;
        match first.as_str() {
            "crate" => self.member(&[], rest, n_doors),
            "self" => self.definition(module, rest, n_doors),
            "super" => {
                let parent = &module[..module.len().checked_sub(1)?];
                let is_higher = rest.first().is_some_and(|name| name == "super");
                if is_higher {
                    self.definition(parent, rest, n_doors)
                } else {
                    self.member(parent, rest, n_doors)
                }
            }
            _ if own.children.contains(first) || own.items.contains(first) => {
                self.member(module, path, n_doors)
            }
            _ => {
                // Another crate is imported under its own name.
                let import = own.imports.get(first).filter(|import| import.first() != Some(first))?;
                self.definition(module, &[import, rest].concat(), n_doors + 1)
            }
        }
    }

    /// Returns the file that defines the member `path` of `module`. What no file declares, such as the items
    /// of a macro, belongs to the module itself.
    fn member(&self, module: &[String], path: &[String], n_doors: usize) -> Option<&str> {
        let own = self.0.get(module)?;
        let (first, rest) = path.split_first()?;
        // A function may have the name of the module that it is re-exported from.
        let is_item = rest.is_empty() && own.imports.contains_key(first);
        if own.children.contains(first) && !is_item {
            return self.member(&[module, slice::from_ref(first)].concat(), rest, n_doors);
        }
        if let Some(import) = own.imports.get(first).filter(|_| !own.items.contains(first)) {
            return self.definition(module, &[import, rest].concat(), n_doors + 1);
        }
        let through = |glob: &ItemPath| self.definition(module, &[glob, path].concat(), n_doors + 1);
        let by_glob = own.globs.iter().filter(|_| !own.items.contains(first)).find_map(through);
        by_glob.or(Some(&own.file))
    }

    /// Returns the files that each file depends on, and a path by which it names something there.
    fn edges(&self) -> BTreeMap<&str, BTreeMap<&str, &ItemPath>> {
        let edges = self.0.iter().map(|(path, module)| {
            let found = module.dependencies().filter_map(|to| Some((self.definition(path, to, 0)?, to)));
            (module.file.as_str(), found.filter(|(file, _)| *file != module.file).collect())
        });
        edges.collect()
    }
}

/// Returns the names that a tree of `use` brings into scope, and the modules whose every name it brings.
fn flatten(
    prefix: &[String],
    tree: &[TokenTree],
    named: &mut Vec<(String, ItemPath)>,
    globs: &mut Vec<ItemPath>,
) {
    for branch in tree.split(|token| is_punct(token, ',')) {
        let (mut path, mut alias, mut is_leaf) = (prefix.to_vec(), None, false);
        for (at, token) in branch.iter().enumerate() {
            match token {
                TokenTree::Ident(word) if *word == "as" => {
                    alias = branch.get(at + 1).and_then(name);
                    break;
                }
                TokenTree::Ident(word) => {
                    path.push(word.to_string());
                    is_leaf = true;
                }
                TokenTree::Group(group) => {
                    let inner: Vec<TokenTree> = group.stream().into_iter().collect();
                    flatten(&path, &inner, named, globs);
                    is_leaf = false;
                }
                TokenTree::Punct(punct) if punct.as_char() == '*' => {
                    globs.push(path.clone());
                    is_leaf = false;
                }
                TokenTree::Punct(_) | TokenTree::Literal(_) => {}
            }
        }
        if path.last().is_some_and(|last| last == "self") {
            path.pop();
        }
        if let Some(name) = alias.or_else(|| path.last().cloned()).filter(|_| is_leaf) {
            named.push((name, path));
        }
    }
}

/// Returns `true` if the group at `at` belongs to an attribute.
fn is_attribute(tokens: &[TokenTree], at: usize) -> bool {
    at > 0
        && (is_punct(&tokens[at - 1], '#')
            || at > 1 && is_punct(&tokens[at - 1], '!') && is_punct(&tokens[at - 2], '#'))
}

/// Returns `true` if the `use` at `at` follows `pub` or `pub(crate)`.
fn is_door(tokens: &[TokenTree], at: usize) -> bool {
    let is_pub = |at: usize| tokens.get(at).and_then(name).is_some_and(|word| word == "pub");
    let is_scope = |at: usize| matches!(&tokens[at], TokenTree::Group(group) if group.delimiter() == Delimiter::Parenthesis);
    at > 0 && (is_pub(at - 1) || at > 1 && is_scope(at - 1) && is_pub(at - 2))
}

fn is_punct(token: &TokenTree, character: char) -> bool {
    matches!(token, TokenTree::Punct(punct) if punct.as_char() == character)
}

fn name(token: &TokenTree) -> Option<String> {
    match token {
        TokenTree::Ident(word) => Some(word.to_string()),
        _ => None,
    }
}

/// Returns the path that starts at `tokens[at]`, at an identifier.
fn path_at(tokens: &[TokenTree], mut at: usize) -> ItemPath {
    let mut path = vec![tokens[at].to_string()];
    while let [colon, second, next, ..] = &tokens[at + 1..] {
        let Some(next) = name(next).filter(|_| is_punct(colon, ':') && is_punct(second, ':')) else { break };
        path.push(next);
        at += 3;
    }
    path
}

/// Returns the crates of the workspace, without their tests.
fn crates() -> BTreeMap<String, Crate> {
    let mut crates = BTreeMap::<String, Crate>::new();
    for source in rust_sources() {
        let Some((name, inside)) = source.path.split_once("/src/") else { continue };
        let inside = inside.trim_end_matches(".rs").trim_end_matches("/mod");
        let path = match inside {
            "bin" => continue,
            "lib" => Vec::new(),
            _ => inside.split('/').map(str::to_owned).collect(),
        };
        let modules = crates.entry(name.to_owned()).or_insert_with(|| Crate(BTreeMap::new()));
        modules.0.insert(path, Module::read(&source));
    }
    for modules in crates.values_mut() {
        let child_of = |path: &ItemPath, name: &String| [path, slice::from_ref(name)].concat();
        let tests = modules
            .0
            .iter()
            .flat_map(|(path, module)| module.test_children.iter().map(move |name| child_of(path, name)));
        let tests: Vec<ItemPath> = tests.collect();
        modules.0.retain(|path, _| !tests.iter().any(|test| path.starts_with(test)));
    }
    crates
}

/// Returns the files that `from` depends on, directly or through others.
fn reachable<'a>(
    edges: &BTreeMap<&'a str, BTreeMap<&'a str, &ItemPath>>,
    from: &'a str,
) -> BTreeSet<&'a str> {
    let (mut seen, mut open) = (BTreeSet::new(), vec![from]);
    while let Some(file) = open.pop() {
        open.extend(edges[file].keys().copied().filter(|to| seen.insert(*to)));
    }
    seen
}

/// Returns the dependencies that lie on a circle, one line each.
fn circles(modules: &Crate) -> Vec<String> {
    let edges = modules.edges();
    let reached: BTreeMap<&str, BTreeSet<&str>> =
        edges.keys().map(|&file| (file, reachable(&edges, file))).collect();
    let all = edges.iter().flat_map(|(from, to)| to.iter().map(move |(to, path)| (from, to, path)));
    let circular = all.filter(|(from, to, _)| reached[*to].contains(*from));
    circular.map(|(from, to, path)| format!("{from} names {} of {to}", path.join("::"))).collect()
}

#[test]
fn modules_form_no_circles() {
    let crates = crates();
    let n_edges: usize =
        crates.values().flat_map(|modules| modules.edges().into_values()).map(|to| to.len()).sum();
    assert!(n_edges > 1000, "found only {n_edges} dependencies between files");
    let found: Vec<String> = crates.values().flat_map(circles).collect();
    assert_none(&found, "these files depend on each other; move what they share below them");
}

#[test]
fn circles_are_found_through_doors() {
    let file = |path: &str, text: &str| Source { path: path.to_owned(), text: text.to_owned() };
    let of = |files: [Source; 3]| {
        let paths =
            [vec![], vec!["a"], vec!["a", "b"]].map(|path| path.into_iter().map(str::to_owned).collect());
        circles(&Crate(paths.into_iter().zip(files.iter().map(Module::read)).collect()))
    };
    let root = "mod a; pub use a::B;";
    let child = "use crate::A; pub struct B(A); #[cfg(test)] mod tests { use super::super::C; }";
    let uses_child = "mod b; pub use b::B; pub struct A; fn f() { vec![b::B::new()]; }";
    let found = of([file("root", "mod a; pub use a::{A, B};"), file("a", uses_child), file("b", child)]);
    assert_eq!(found, ["a names b::B::new of b", "b names crate::A of a"]);
    let has_door = "mod b; pub use b::B; pub struct A; pub struct C;";
    assert_eq!(
        of([file("root", "mod a; pub use a::{A, B};"), file("a", has_door), file("b", child)]),
        [""; 0]
    );
    let in_tests = "mod b; #[cfg(test)] fn f() -> b::B {} pub struct A;";
    assert_eq!(of([file("root", root), file("a", in_tests), file("b", child)]), [""; 0]);
    let same_name = [
        file("root", "mod a; use a::b; pub struct A; fn f() { b() }"),
        file("a", "mod b; pub use b::b;"),
        file("b", "pub fn b() -> crate::A {}"),
    ];
    assert_eq!(of(same_name), ["b names crate::A of root", "root names a::b of b"]);
}
