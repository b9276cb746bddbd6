//! Custom properties and `var()` (CSS Custom Properties Level 1).

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::rc::Rc;

use super::syntax::find;

/// Longest value after all replacements, bytes.
const LONGEST: usize = 4096;
/// Deepest nesting of references.
const MAX_DEPTH: usize = 32;

/// The values of custom properties; one that cannot be known has none.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Variables(BTreeMap<String, Option<Rc<str>>>);

/// A value that cannot be known.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Unknown;

impl Variables {
    /// The custom properties of an element with these declarations, those that win last; each with whether it is uncertain.
    pub(super) fn with<'s>(
        self: &Rc<Self>,
        declared: impl Iterator<Item = (&'s str, &'s str, bool)>,
    ) -> Rc<Self> {
        let mut own: BTreeMap<&str, Option<&str>> = BTreeMap::new();
        for (name, value, is_uncertain) in declared {
            own.insert(name, (!is_uncertain).then_some(value));
        }
        if own.is_empty() {
            return self.clone();
        }
        let mut done = Self(self.0.clone());
        // Those that are declared here are added again when their values are known.
        for name in own.keys() {
            done.0.remove(*name);
        }
        let names: Vec<&str> = own.keys().copied().collect();
        for name in names {
            settle(name, &own, self, &mut done, 0);
        }
        done.0.retain(|_, value| value.as_deref() != Some(NOTHING));
        Rc::new(done)
    }
}

/// Stands for a custom property without a value, which is no text of a drawing.
const NOTHING: &str = "\0";

/// Finds the value of a custom property that is declared at the element.
fn settle(
    name: &str,
    own: &BTreeMap<&str, Option<&str>>,
    outer: &Variables,
    done: &mut Variables,
    depth: usize,
) {
    if done.0.contains_key(name) {
        return;
    }
    // A property that refers to itself on the way is found here.
    done.0.insert(name.to_owned(), None);
    let Some(Some(text)) = own.get(name).copied() else { return };
    let nothing = || Some(Rc::from(NOTHING));
    let value = match text.trim().to_ascii_lowercase().as_str() {
        "initial" => nothing(),
        "inherit" | "unset" | "revert" => outer.0.get(name).cloned().unwrap_or_else(nothing),
        "revert-layer" => None,
        _ => {
            if depth < MAX_DEPTH {
                for inside in names(text) {
                    if own.contains_key(inside) {
                        settle(inside, own, outer, done, depth + 1);
                    }
                }
                match resolved(text, done) {
                    Ok(Some(value)) => Some(Rc::from(value.trim())),
                    Ok(None) => nothing(),
                    Err(Unknown) => None,
                }
            } else {
                None
            }
        }
    };
    done.0.insert(name.to_owned(), value);
}

/// The names of custom properties in a text.
fn names(text: &str) -> impl Iterator<Item = &str> {
    text.match_indices("--").map(|(at, _)| {
        let rest = &text[at..];
        let end = rest.find(|letter: char| letter.is_ascii_whitespace() || ",)".contains(letter));
        &rest[..end.unwrap_or(rest.len())]
    })
}

/// A value with its references to custom properties replaced; `None` if one has neither a value nor a fallback.
pub(super) fn resolved<'v>(value: &'v str, variables: &Variables) -> Result<Option<Cow<'v, str>>, Unknown> {
    resolved_at(value, variables, 0)
}

fn resolved_at<'v>(
    value: &'v str,
    variables: &Variables,
    depth: usize,
) -> Result<Option<Cow<'v, str>>, Unknown> {
    let lower = value.to_ascii_lowercase();
    let Some(at) = lower.find("var(") else { return Ok(Some(Cow::Borrowed(value))) };
    if depth > MAX_DEPTH {
        return Err(Unknown);
    }
    let inside = &value[at + 4..];
    let end = find(inside, &[')']);
    let comma = find(&inside[..end], &[',']);
    let name = inside[..comma].trim();
    let replaced = match variables.0.get(name) {
        Some(None) => return Err(Unknown),
        Some(Some(value)) if &**value != NOTHING => Cow::Borrowed(&**value),
        _ => match inside[comma..end].strip_prefix(',') {
            Some(fallback) => match resolved_at(fallback, variables, depth + 1)? {
                Some(value) => value,
                None => return Ok(None),
            },
            None => return Ok(None),
        },
    };
    let rest = inside[end..].strip_prefix(')').unwrap_or_default();
    let Some(rest) = resolved_at(rest, variables, depth + 1)? else { return Ok(None) };
    let whole = format!("{}{replaced}{rest}", &value[..at]);
    if whole.len() > LONGEST { Err(Unknown) } else { Ok(Some(Cow::Owned(whole))) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_replaced_as_css_defines() {
        let outer = Rc::new(Variables::default()).with(
            [("--a", " red ", false), ("--b", "var(--a)", false), ("--u", "x", true), ("--e", "", false)]
                .into_iter(),
        );
        let own = [
            ("--a", "blue", false),
            ("--c", "var(--d, 1) 2", false),
            ("--l", "var(--m)", false),
            ("--m", "var(--l)", false),
            ("--n", "var(--none)", false),
            ("--z", "var(--y)", false),
            ("--y", "3", false),
            ("--i", "initial", false),
            ("--A", "big", false),
        ];
        let variables = outer.with(own.into_iter());
        for (text, expected) in [
            ("plain", Ok(Some("plain"))),
            ("var(--a)", Ok(Some("blue"))),
            // The value at the outer element.
            ("var(--b)", Ok(Some("red"))),
            ("VAR( --A )", Ok(Some("big"))),
            ("var(--c) var(--y)px", Ok(Some("1 2 3px"))),
            ("var(--z)", Ok(Some("3"))),
            ("var(--none)", Ok(None)),
            ("var(--i)", Ok(None)),
            ("var(--n, var(--a, x))", Ok(Some(" blue"))),
            ("var(--none,)", Ok(Some(""))),
            ("var(--e)", Ok(Some(""))),
            ("var(--u)", Err(Unknown)),
            ("var(--l)", Err(Unknown)),
        ] {
            let found = resolved(text, &variables);
            assert_eq!(found, expected.map(|value| value.map(Cow::Borrowed)), "{text}");
        }
    }

    #[test]
    fn values_that_multiply_end() {
        let names: Vec<(String, String)> = (0..60)
            .map(|at| (format!("--a{at}"), format!("var(--a{0})var(--a{0})", at + 1)))
            .chain([("--a60".into(), "0123456789".into())])
            .collect();
        let all = names.iter().map(|(name, value)| (name.as_str(), value.as_str(), false));
        let variables = Rc::new(Variables::default()).with(all);
        assert_eq!(resolved("var(--a0)", &variables), Err(Unknown));
        assert_eq!(resolved("var(--a60)", &variables), Ok(Some(Cow::Borrowed("0123456789"))));
    }
}
