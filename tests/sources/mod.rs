//! The sources as text: a file without comments, string literals and tests, and the paths that it uses.

#![allow(unreachable_pub, reason = "a module of tests")]

use std::path::{Path, PathBuf};

mod circles;
mod codes;
mod growth;

pub use circles::Modules;

/// The Rust files below a folder, sorted.
pub fn walk(folder: &Path) -> Vec<PathBuf> {
    let mut entries: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    entries.sort();
    let nested = entries.into_iter().flat_map(|path| if path.is_dir() { walk(&path) } else { vec![path] });
    nested.filter(|path| path.extension().is_some_and(|ending| ending == "rs")).collect()
}

pub fn is_word(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// The source with comments, string and character literals replaced by blanks; line numbers do not change.
pub fn without_comments_and_texts(source: &str) -> Vec<char> {
    read(source).0
}

/// A text in the source, without its quotation marks.
pub struct Text {
    /// Where it starts, in characters.
    pub at: usize,
    pub text: String,
}

/// The texts of the source, without those of items that are compiled for tests only.
pub fn texts(source: &str) -> Vec<Text> {
    const MARK: char = '\u{1}';
    let (mut code, mut texts) = read(source);
    texts.iter().for_each(|text| code[text.at] = MARK);
    let code = without_tests(&code);
    texts.retain(|text| code[text.at] == MARK);
    texts
}

fn read(source: &str) -> (Vec<char>, Vec<Text>) {
    let source: Vec<char> = source.chars().collect();
    let mut texts = Vec::new();
    let at = |index: usize| source.get(index).copied().unwrap_or('\0');
    let mut code = Vec::with_capacity(source.len());
    let mut index = 0;
    while index < source.len() {
        let after_word = index > 0 && is_word(at(index - 1));
        let hashes = (index + 1..).take_while(|&next| at(next) == '#').count();
        let end = match at(index) {
            '/' if at(index + 1) == '/' => (index..).find(|&next| matches!(at(next), '\n' | '\0')).unwrap(),
            '/' if at(index + 1) == '*' => {
                let mut open = 0;
                let mut next = index;
                loop {
                    match (at(next), at(next + 1)) {
                        ('/', '*') => (open, next) = (open + 1, next + 2),
                        ('*', '/') => (open, next) = (open - 1, next + 2),
                        ('\0', _) => break next,
                        _ => next += 1,
                    }
                    if open == 0 {
                        break next;
                    }
                }
            }
            'r' if (!after_word || at(index - 1) == 'b') && at(index + 1 + hashes) == '"' => {
                let closes = |next: usize| at(next) == '"' && (1..=hashes).all(|hash| at(next + hash) == '#');
                let first = index + hashes + 2;
                (first..).find(|&next| closes(next) || next >= source.len()).unwrap() + hashes + 1
            }
            '"' => {
                let mut next = index + 1;
                while !matches!(at(next), '"' | '\0') {
                    next += if at(next) == '\\' { 2 } else { 1 };
                }
                next + 1
            }
            '\'' if at(index + 1) == '\\' => {
                (index + 3..).find(|&next| matches!(at(next), '\'' | '\0')).unwrap() + 1
            }
            '\'' if at(index + 2) == '\'' => index + 3,
            _ => {
                code.push(at(index));
                index += 1;
                continue;
            }
        };
        let end = end.min(source.len());
        if let Some(quote) =
            (index..end).find(|&at| source[at] == '"').filter(|_| !matches!(at(index), '/' | '\''))
        {
            let text: String = source[quote + 1..end].iter().collect();
            let text = text.trim_end_matches('#').trim_end_matches('"').to_owned();
            texts.push(Text { at: index, text });
        }
        code.extend(source[index..end].iter().map(|&c| if c == '\n' { '\n' } else { ' ' }));
        index = end;
    }
    (code, texts)
}

/// The code with every item that is compiled only for tests replaced by blanks.
pub fn without_tests(code: &[char]) -> Vec<char> {
    let mut code = code.to_vec();
    let attribute: Vec<char> = "#[cfg(test)]".chars().collect();
    let mut index = 0;
    while index + attribute.len() <= code.len() {
        if code[index..index + attribute.len()] != attribute[..] {
            index += 1;
            continue;
        }
        let mut end = index + attribute.len();
        let mut open = 0;
        while end < code.len() {
            match code[end] {
                '{' => open += 1,
                '}' => open -= 1,
                _ => {}
            }
            end += 1;
            if open == 0 && matches!(code[end - 1], '}' | ';') {
                break;
            }
        }
        code[index..end].iter_mut().filter(|c| **c != '\n').for_each(|c| *c = ' ');
        index = end;
    }
    code
}

/// A path in the code, such as `super::hatch::lines`.
pub struct Named {
    /// Its position, in characters.
    pub at: usize,
    pub steps: Vec<String>,
    /// The name after `as`.
    pub alias: Option<String>,
    pub kind: Kind,
}

/// How a path is used.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// In code, without `use`.
    Used,
    /// In a `use`.
    Imported,
    /// In a `pub use` of any visibility.
    ReExported,
}

/// Every path with more than one step, and every name in a `use`, with the groups of a `use` expanded.
pub fn paths(code: &[char]) -> Vec<Named> {
    let mut paths = Vec::new();
    let mut index = 0;
    let mut kind = Kind::Used;
    while index < code.len() {
        if !is_word(code[index]) {
            index += 1;
            continue;
        }
        let before = code[..index].iter().rposition(|c| !c.is_whitespace());
        let is_inner = before.is_some_and(|at| code[at] == '.');
        let mut found = Vec::new();
        index = read_path(code, index, &[], kind, &mut found);
        let is_use = found.first().is_some_and(|first| first.steps == ["use"]);
        if !is_inner {
            paths.extend(found.into_iter().filter(|path| path.steps.len() > 1 || kind != Kind::Used));
        }
        // Before `use` there is `pub`, `pub(…)`, or the end of another item.
        kind = match before.map(|at| code[at]) {
            _ if !is_use => Kind::Used,
            Some(c) if is_word(c) || c == ')' => Kind::ReExported,
            _ => Kind::Imported,
        };
    }
    paths
}

/// Reads one path, which starts at a word, adds it (or, for a group, each of its members) and returns its end.
fn read_path(code: &[char], start: usize, before: &[String], kind: Kind, found: &mut Vec<Named>) -> usize {
    let skip = |from: usize| (from..code.len()).find(|&at| !code[at].is_whitespace()).unwrap_or(code.len());
    let word_end = |from: usize| (from..code.len()).find(|&at| !is_word(code[at])).unwrap_or(code.len());
    let word = |from: usize| code[from..word_end(from)].iter().collect::<String>();
    let end = word_end(start);
    let mut steps = before.to_vec();
    steps.push(word(start));
    let next = skip(end);
    if code.get(next..next + 2) != Some(&[':', ':']) {
        let name = skip(word_end(next));
        let is_renamed = kind != Kind::Used && word(next) == "as" && name < code.len();
        let alias = is_renamed.then(|| word(name));
        found.push(Named { at: start, steps, alias, kind });
        return if is_renamed { word_end(name) } else { end };
    }
    let next = skip(next + 2);
    match code.get(next) {
        Some('{') => {
            let mut at = next + 1;
            while at < code.len() && code[at] != '}' {
                at = if is_word(code[at]) { read_path(code, at, &steps, kind, found) } else { at + 1 };
            }
            at + 1
        }
        Some(&c) if is_word(c) => read_path(code, next, &steps, kind, found),
        _ => {
            found.push(Named { at: start, steps, alias: None, kind });
            next
        }
    }
}
