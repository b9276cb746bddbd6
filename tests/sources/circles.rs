//! Circles: files of the crate that import each other, directly or through others.

use std::collections::{BTreeMap, BTreeSet};

use super::{Kind, Named, paths, without_comments_and_texts, without_tests};

/// Names that lead through more modules than this are treated as names of other crates.
const MAX_STEPS: usize = 16;

/// The modules of a crate, with the paths that each one uses.
#[derive(Default)]
pub struct Modules {
    /// By their steps from the root of the crate.
    modules: BTreeMap<Vec<String>, Module>,
}

struct Module {
    file: String,
    paths: Vec<Named>,
    /// What `use` imports into it, by its local name.
    names: BTreeMap<String, Vec<String>>,
}

/// Files that import each other, sorted, with an arrow for each import: from, to, imported names.
pub struct Circle {
    pub files: Vec<String>,
    pub arrows: Vec<(String, String, String)>,
}

impl Modules {
    /// Adds a file, with its path in the crate, such as `src/formats/mod.rs`.
    pub fn add(&mut self, file: &str, source: &str) {
        let mut steps: Vec<String> =
            file.trim_start_matches("src/").trim_end_matches(".rs").split('/').map(str::to_owned).collect();
        if steps.last().is_some_and(|last| last == "mod" || (steps.len() == 1 && last == "lib")) {
            steps.pop();
        }
        let paths = paths(&without_tests(&without_comments_and_texts(source)));
        let imports = paths.iter().filter(|path| path.kind != Kind::Used);
        let names = imports.filter_map(|path| {
            let mut steps = path.steps.clone();
            if steps.len() > 1 {
                steps.pop_if(|last| last == "self");
            }
            Some((path.alias.clone().or_else(|| steps.last().cloned())?, steps))
        });
        let module = Module { file: file.to_owned(), names: names.collect(), paths };
        self.modules.insert(steps, module);
    }

    /// Circles of two or more files, sorted. A re-export is not an import: a file that uses the re-exported name
    /// imports from the file that defines it.
    pub fn circles(&self) -> Vec<Circle> {
        let mut arrows: BTreeMap<&str, BTreeMap<&str, BTreeSet<&str>>> = BTreeMap::new();
        for (place, module) in &self.modules {
            for path in module.paths.iter().filter(|path| path.kind != Kind::ReExported) {
                let Some(home) = self.home(place, &path.steps, MAX_STEPS) else { continue };
                if home.file != module.file {
                    let name = path.steps.last().map_or("", String::as_str);
                    arrows.entry(&module.file).or_default().entry(&home.file).or_default().insert(name);
                }
            }
        }
        let reached: BTreeMap<&str, BTreeSet<&str>> = arrows
            .keys()
            .map(|&from| {
                let (mut seen, mut front) = (BTreeSet::new(), vec![from]);
                while let Some(file) = front.pop() {
                    let next = arrows.get(file).into_iter().flat_map(BTreeMap::keys);
                    front.extend(next.filter(|to| seen.insert(**to)));
                }
                (from, seen)
            })
            .collect();
        let mut circles: Vec<Circle> = Vec::new();
        for (&first, ahead) in reached.iter().filter(|(first, ahead)| ahead.contains(*first)) {
            let files: Vec<String> = ahead
                .iter()
                .filter(|file| reached.get(*file).is_some_and(|back| back.contains(first)))
                .map(|file| (*file).to_owned())
                .collect();
            if files.first().is_none_or(|smallest| smallest != first) {
                continue;
            }
            let is_inside = |file: &str| files.iter().any(|known| known == file);
            let inside = arrows.iter().filter(|(from, _)| is_inside(from)).flat_map(|(from, targets)| {
                targets.iter().filter(|(to, _)| is_inside(to)).map(|(to, names)| {
                    let names: Vec<&str> = names.iter().copied().collect();
                    ((*from).to_owned(), (*to).to_owned(), names.join(", "))
                })
            });
            circles.push(Circle { arrows: inside.collect(), files: files.clone() });
        }
        circles
    }

    /// The module that defines the target of a path, as seen from the module at `place`; `None` for paths into other
    /// crates and for paths to a module.
    fn home(&self, place: &[String], path: &[String], steps_left: usize) -> Option<&Module> {
        let steps_left = steps_left.checked_sub(1)?;
        let first = path.first()?;
        let (mut at, mut rest) = match first.as_str() {
            "crate" => (Vec::new(), &path[1..]),
            "self" => (place.to_vec(), &path[1..]),
            "super" => (place[..place.len().checked_sub(1)?].to_vec(), &path[1..]),
            _ if self.modules.contains_key(&join(place, first)) => (join(place, first), &path[1..]),
            // An imported name is resolved through its import.
            _ => {
                let target = self.modules.get(place)?.names.get(first)?;
                // `use toml` imports a crate under its own name.
                let is_path = target.len() > 1 || target.first() != Some(first);
                let resolved = [target, &path[1..]].concat();
                return if is_path && resolved != path {
                    self.home(place, &resolved, steps_left)
                } else {
                    None
                };
            }
        };
        while let Some(step) = rest.first() {
            if step == "super" {
                at.pop()?;
            } else if self.modules.contains_key(&join(&at, step)) {
                at.push(step.clone());
            } else {
                let module = self.modules.get(&at)?;
                return match module.names.get(step) {
                    Some(target) => self.home(&at, &[target, &rest[1..]].concat(), steps_left),
                    None => Some(module),
                };
            }
            rest = &rest[1..];
        }
        None
    }
}

fn join(place: &[String], step: &str) -> Vec<String> {
    [place, &[step.to_owned()]].concat()
}
