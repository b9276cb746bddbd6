//! Style sheets: their rules, in the order of the cascade (CSS Syntax Level 3, Cascading and Inheritance Level 5, Media Queries
//! Level 4).
//!
//! A condition or selector that cannot be evaluated is [`Truth::Unknown`]; its rule stays in the list with its text.

use std::borrow::Cow;
use std::rc::Rc;

use super::selector::{self, Selector};
use super::syntax::{Truth, find, listed};

/// Deepest nesting of groups of rules.
const MAX_DEPTH: usize = 16;
/// Longest part of a rule in messages, characters.
const SHOWN: usize = 60;

/// A property with its value.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Declaration {
    /// In lower case, but for custom properties.
    pub(super) name: String,
    pub(super) value: String,
    pub(super) is_important: bool,
}

/// A selector with the declarations of its rule.
#[derive(Debug)]
pub(super) struct Rule {
    pub(super) selector: Selector,
    /// Whether the conditions around the rule hold; never [`Truth::No`].
    pub(super) condition: Truth,
    /// The layer of the cascade, by its first mention; rules outside of layers come after all.
    pub(super) layer: usize,
    pub(super) declarations: Rc<[Declaration]>,
    /// What to call the rule in messages.
    pub(super) text: Rc<str>,
}

/// The rules of all style sheets of a drawing.
#[derive(Debug, Default)]
pub(super) struct Sheet {
    pub(super) rules: Vec<Rule>,
    /// Other files with style sheets.
    pub(super) imports: Vec<String>,
    layers: Vec<String>,
}

/// What is around a rule.
#[derive(Clone, Copy)]
struct Group<'t> {
    condition: Truth,
    layer: usize,
    /// The condition that cannot be evaluated.
    text: &'t str,
    depth: usize,
}

impl Sheet {
    /// Adds the rules of a style sheet for the given media.
    pub(super) fn add(&mut self, text: &str, media: &str) {
        let condition = media_holds(media);
        if condition != Truth::No {
            let text = without_comments(text);
            let group = Group { condition, layer: usize::MAX, text: media, depth: 0 };
            self.add_rules(&text, group);
        }
    }

    /// Sorts the rules by layer and specificity, as the cascade applies them.
    pub(super) fn sort(&mut self) {
        self.rules.sort_by_key(|rule| (rule.layer, rule.selector.specificity));
    }

    fn add_rules(&mut self, text: &str, group: Group<'_>) {
        let mut rest = text;
        loop {
            rest = rest.trim_start();
            for sign in ["<!--", "-->", ";", "}"] {
                rest = rest.strip_prefix(sign).unwrap_or(rest).trim_start();
            }
            if rest.is_empty() {
                return;
            }
            let end = find(rest, &['{', ';']);
            // Only an at-rule can end without a block.
            let end = match rest.starts_with('@') {
                true => end,
                false => find(rest, &['{']),
            };
            let prelude = rest[..end].trim();
            let has_block = rest[end..].starts_with('{');
            let block = match has_block {
                true => {
                    let inside = &rest[end + 1..];
                    let close = find(inside, &['}']);
                    rest = inside[close..].strip_prefix('}').unwrap_or_default();
                    &inside[..close]
                }
                false => {
                    rest = rest[end..].strip_prefix(';').unwrap_or_default();
                    ""
                }
            };
            match prelude.strip_prefix('@') {
                Some(rule) => self.at_rule(rule, block, has_block, group),
                None if has_block => self.rule(prelude, block, group),
                None => {}
            }
        }
    }

    fn at_rule(&mut self, rule: &str, block: &str, has_block: bool, group: Group<'_>) {
        let end = rest_of_name(rule);
        let (name, prelude) = (rule[..end].to_ascii_lowercase(), rule[end..].trim());
        let unknown = Group { condition: Truth::Unknown, text: rule, depth: group.depth + 1, ..group };
        match name.as_str() {
            // These draw nothing, or only what moves or is printed on pages.
            "charset"
            | "namespace"
            | "font-face"
            | "font-feature-values"
            | "font-palette-values"
            | "keyframes"
            | "-webkit-keyframes"
            | "-moz-keyframes"
            | "-o-keyframes"
            | "page"
            | "counter-style"
            | "color-profile"
            | "view-transition"
            | "position-try"
            | "viewport"
            | "-ms-viewport" => {}
            "import" => self.imports.push(shown(prelude)),
            _ if group.depth >= MAX_DEPTH => self.unread_rule(rule, block, group),
            "media" => {
                let holds = media_holds(prelude);
                let text = if holds == Truth::Unknown { rule } else { group.text };
                let condition = holds.min(group.condition);
                if condition != Truth::No {
                    self.add_rules(block, Group { condition, text, depth: group.depth + 1, ..group });
                }
            }
            "layer" if group.layer != usize::MAX || prelude.contains('.') => self.add_rules(block, unknown),
            "layer" if !has_block => {
                for name in prelude.split(',') {
                    self.layer(name.trim());
                }
            }
            "layer" => {
                let layer = self.layer(prelude);
                self.add_rules(block, Group { layer, depth: group.depth + 1, ..group });
            }
            // Properties inside it are of no element.
            "property" => self.unread_rule(rule, block, group),
            _ => self.add_rules(block, unknown),
        }
    }

    /// The number of a layer; without name it is a new one.
    fn layer(&mut self, name: &str) -> usize {
        match self.layers.iter().position(|known| known == name && !name.is_empty()) {
            Some(at) => at,
            None => {
                self.layers.push(name.into());
                self.layers.len() - 1
            }
        }
    }

    fn rule(&mut self, prelude: &str, block: &str, group: Group<'_>) {
        let (declarations, nested) = declarations_and_rules(block);
        for (rule, block) in nested {
            self.unread_rule(rule, block, group);
        }
        if declarations.is_empty() {
            return;
        }
        let declarations: Rc<[Declaration]> = declarations.into();
        let text: Rc<str> = match group.condition {
            Truth::Unknown => shown(group.text).into(),
            _ => shown(prelude).into(),
        };
        for selector in selector::parsed(prelude) {
            self.rules.push(Rule {
                selector,
                condition: group.condition,
                layer: group.layer,
                declarations: declarations.clone(),
                text: text.clone(),
            });
        }
    }

    /// A rule with elements that are not known.
    fn unread_rule(&mut self, rule: &str, block: &str, group: Group<'_>) {
        let (mut declarations, nested) = declarations_and_rules(block);
        if group.depth < MAX_DEPTH {
            for (rule, block) in nested {
                self.unread_rule(rule, block, Group { depth: group.depth + 1, ..group });
            }
        } else if !nested.is_empty() {
            // Too deep to look for what it sets.
            declarations.push(Declaration { name: "all".into(), value: "unset".into(), is_important: true });
        }
        self.rules.push(Rule {
            selector: Selector::unknown(),
            condition: group.condition,
            layer: group.layer,
            declarations: declarations.into(),
            text: shown(rule).into(),
        });
    }
}

/// Text of a rule for messages, on one line and not too long.
fn shown(text: &str) -> String {
    let words: Vec<&str> = text.split_whitespace().collect();
    let line = words.join(" ");
    match line.chars().count() > SHOWN {
        true => line.chars().take(SHOWN).chain(['\u{2026}']).collect(),
        false => line,
    }
}

/// The declarations of an attribute `style`.
pub(super) fn declarations(text: &str) -> Vec<Declaration> {
    declarations_and_rules(&without_comments(text)).0
}

/// The declarations of a block, and the rules that are nested in it with their blocks.
fn declarations_and_rules(block: &str) -> (Vec<Declaration>, Vec<(&str, &str)>) {
    let (mut declarations, mut nested) = (Vec::new(), Vec::new());
    let mut rest = block.trim_start();
    while !rest.is_empty() {
        let is_custom = rest.starts_with("--");
        let end = find(rest, &[';', '{']);
        if rest[end..].starts_with('{') && !is_custom {
            let inside = &rest[end + 1..];
            let close = find(inside, &['}']);
            nested.push((rest[..end].trim(), &inside[..close]));
            rest = inside[close..].strip_prefix('}').unwrap_or_default().trim_start();
            continue;
        }
        let end = if is_custom { find(rest, &[';']) } else { end };
        declarations.extend(declaration(&rest[..end]));
        rest = rest[end..].trim_start_matches(';').trim_start();
    }
    (declarations, nested)
}

fn declaration(text: &str) -> Option<Declaration> {
    let (name, value) = text.split_once(':')?;
    let name = name.trim();
    if name.is_empty() || rest_of_name(name) != name.len() {
        return None;
    }
    let mut value = value.trim();
    let mut is_important = false;
    if let Some((before, word)) = value.rsplit_once('!')
        && word.trim().eq_ignore_ascii_case("important")
    {
        (value, is_important) = (before.trim_end(), true);
    }
    let is_custom = name.starts_with("--");
    let name = if is_custom { name.to_owned() } else { name.to_ascii_lowercase() };
    (is_custom || !value.is_empty()).then(|| Declaration { name, value: value.into(), is_important })
}

/// Where a name that begins the text ends.
fn rest_of_name(text: &str) -> usize {
    let is_part =
        |letter: char| letter.is_ascii_alphanumeric() || "-_".contains(letter) || !letter.is_ascii();
    text.find(|letter| !is_part(letter)).unwrap_or(text.len())
}

/// The text without comments; a blank stays where words would join.
fn without_comments(text: &str) -> Cow<'_, str> {
    if !text.contains("/*") {
        return Cow::Borrowed(text);
    }
    let mut plain = String::with_capacity(text.len());
    let mut rest = text;
    let mut mark: Option<char> = None;
    while let Some(letter) = rest.chars().next() {
        if mark.is_none() && rest.starts_with("/*") {
            rest = rest[2..].split_once("*/").map_or("", |(_, after)| after);
            let is_word = |letter: char| letter.is_alphanumeric() || "-_%".contains(letter);
            if plain.chars().next_back().is_some_and(is_word) && rest.chars().next().is_some_and(is_word) {
                plain.push(' ');
            }
            continue;
        }
        mark = match (mark, letter) {
            (None, '"' | '\'') => Some(letter),
            (Some(open), _) if open == letter => None,
            (Some(_), '\n') => None,
            _ => mark,
        };
        let end = match letter {
            '\\' => 1 + rest[1..].chars().next().map_or(0, char::len_utf8),
            _ => letter.len_utf8(),
        };
        plain.push_str(&rest[..end]);
        rest = &rest[end..];
    }
    Cow::Owned(plain)
}

/// Whether a list of media queries holds for a drawing on a screen, with the light colours that are the default.
fn media_holds(queries: &str) -> Truth {
    if queries.trim().is_empty() {
        return Truth::Yes;
    }
    listed(queries).into_iter().map(query_holds).max().unwrap_or(Truth::No)
}

fn query_holds(query: &str) -> Truth {
    let query = query.to_ascii_lowercase();
    let mut rest = query.trim();
    let is_negated = rest.strip_prefix("not ").inspect(|after| rest = after.trim_start()).is_some();
    rest = rest.strip_prefix("only ").unwrap_or(rest).trim_start();
    let mut holds = Truth::Yes;
    let mut is_first = true;
    while !rest.is_empty() {
        if !is_first {
            match rest.strip_prefix("and").filter(|after| after.starts_with([' ', '\t', '\n', '('])) {
                Some(after) => rest = after.trim_start(),
                None => return Truth::Unknown,
            }
        }
        let part;
        if let Some(inside) = rest.strip_prefix('(') {
            let end = find(inside, &[')']);
            part = feature_holds(inside[..end].trim());
            rest = inside[end..].strip_prefix(')').unwrap_or_default().trim_start();
        } else {
            let end = rest_of_name(rest);
            part = match &rest[..end] {
                "all" | "screen" => Truth::Yes,
                "" => return Truth::Unknown,
                // Other media, known or not.
                _ if is_first => Truth::No,
                _ => return Truth::Unknown,
            };
            rest = rest[end..].trim_start();
        }
        holds = holds.min(part);
        is_first = false;
    }
    if is_negated { holds.not() } else { holds }
}

fn feature_holds(feature: &str) -> Truth {
    let (name, value) = feature.split_once(':').map_or((feature, ""), |(name, value)| (name, value.trim()));
    match (name.trim(), value) {
        ("prefers-color-scheme", value) => (value == "light").into(),
        ("prefers-reduced-motion" | "prefers-contrast" | "prefers-reduced-transparency", value) => {
            (value == "no-preference").into()
        }
        ("forced-colors" | "inverted-colors", value) => (value == "none").into(),
        _ => Truth::Unknown,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn declarations_are_read_as_css_defines() {
        let read = |text: &str| -> Vec<(String, String, bool)> {
            let all = declarations(text).into_iter();
            all.map(|one| (one.name, one.value, one.is_important)).collect()
        };
        let expect =
            |name: &str, value: &str, is_important| (name.to_owned(), value.to_owned(), is_important);
        assert_eq!(
            read("FILL:Red;;stroke : url(\"a;b\") !IMPORTANT; nonsense; /* fill:blue; */ --A: {x;y}"),
            [
                expect("fill", "Red", false),
                expect("stroke", "url(\"a;b\")", true),
                expect("--A", "{x;y}", false)
            ]
        );
        assert_eq!(read("*width:3px; font-family:'a;/*b*/'"), [expect("font-family", "'a;/*b*/'", false)]);
        assert_eq!(read("stroke-dasharray:1/**/2"), [expect("stroke-dasharray", "1 2", false)]);
    }

    #[test]
    fn media_are_those_of_a_screen() {
        for (query, expected) in [
            ("", Truth::Yes),
            ("all", Truth::Yes),
            ("SCREEN", Truth::Yes),
            ("print", Truth::No),
            ("not print", Truth::Yes),
            ("print, screen", Truth::Yes),
            ("only screen and (prefers-color-scheme: dark)", Truth::No),
            ("(prefers-color-scheme:light)", Truth::Yes),
            ("(min-width: 30em)", Truth::Unknown),
            ("print and (min-width: 30em)", Truth::No),
            ("print, (min-width: 30em)", Truth::Unknown),
            ("(width > 3px) or (hover)", Truth::Unknown),
        ] {
            assert_eq!(media_holds(query), expected, "{query}");
        }
    }

    #[test]
    fn groups_of_rules_keep_their_conditions() {
        let mut sheet = Sheet::default();
        sheet.add(
            "@charset \"x\"; @import url(a.css); <!-- @font-face{fill:none} @media print{a{fill:none}} \
             @media screen{b{fill:none}c{}} @layer y, x; @layer x{d{fill:none}} @layer y{e{fill:none}} \
             @supports (fill:red){f{fill:none}} g{fill:none;h &{fill:none}} --> i,j{fill:none",
            "all",
        );
        sheet.sort();
        let rules: Vec<(&str, Truth)> = sheet
            .rules
            .iter()
            .map(|rule| (&*rule.text, rule.condition.min(rule.selector.certainty())))
            .collect();
        assert_eq!(
            rules,
            [
                ("e", Truth::Yes),
                ("d", Truth::Yes),
                ("h &", Truth::Unknown),
                ("b", Truth::Yes),
                ("supports (fill:red)", Truth::Unknown),
                ("g", Truth::Yes),
                ("i,j", Truth::Yes),
                ("i,j", Truth::Yes),
            ]
        );
        assert_eq!(sheet.imports, ["url(a.css)"]);
    }
}
