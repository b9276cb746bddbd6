//! Selectors of style sheets (Selectors Level 4).

use std::cell::Cell;

use roxmltree::Node;

use super::document::attribute;
use super::syntax::{Truth, find, listed};

/// Deepest nesting of selectors in others.
const MAX_DEPTH: usize = 8;
/// Largest number of compounds in a selector.
const MAX_PARTS: usize = 64;
/// Largest number of steps for matching the selectors of style sheets.
const MAX_STEPS: usize = 20_000_000;

/// Numbers of ids, of classes, and of types in a selector; the larger one wins.
pub(super) type Specificity = [usize; 3];

/// Counts the steps of matching in a drawing.
#[derive(Debug, Default)]
pub(super) struct Steps(Cell<usize>);

impl Steps {
    /// Counts a step; whether more are allowed.
    fn step(&self) -> bool {
        self.add(1);
        !self.are_too_many()
    }

    pub(super) fn add(&self, count: usize) {
        self.0.set(self.0.get().saturating_add(count));
    }

    pub(super) fn are_too_many(&self) -> bool {
        self.0.get() > MAX_STEPS
    }
}

/// Compounds from left to right; each with how it follows the one before it.
#[derive(Debug)]
pub(super) struct Selector {
    parts: Vec<(Combinator, Vec<Simple>)>,
    pub(super) specificity: Specificity,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Combinator {
    Inside,
    Child,
    Next,
    After,
}

#[derive(Debug)]
enum Simple {
    Any,
    Type(String),
    Id(String),
    Class(String),
    Attribute {
        name: String,
        test: Test,
        value: String,
        ignores_case: bool,
    },
    Nth {
        a: i64,
        b: i64,
        from_end: bool,
        of_type: bool,
        of: Vec<Selector>,
    },
    Root,
    Empty,
    /// A link that was not followed.
    Link,
    Lang(Vec<String>),
    Not(Vec<Selector>),
    Is(Vec<Selector>),
    Has(Vec<Selector>),
    /// Conditions that no element of a drawing meets without interaction, and parts of elements.
    Never,
    Unknown,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Test {
    Exists,
    Equals,
    Word,
    Language,
    Begins,
    Ends,
    Contains,
}

/// The selectors of a list. One that cannot be read makes the whole list unknown.
pub(super) fn parsed(list: &str) -> Vec<Selector> {
    parse_list(list, 0).unwrap_or_else(|| vec![Selector::unknown()])
}

fn parse_list(list: &str, depth: usize) -> Option<Vec<Selector>> {
    listed(list).into_iter().map(|text| parse(text, depth)).collect()
}

fn parse(text: &str, depth: usize) -> Option<Selector> {
    if depth > MAX_DEPTH {
        return None;
    }
    let mut rest = text.trim();
    let mut selector = Selector { parts: Vec::new(), specificity: [0; 3] };
    let mut combinator = Combinator::Inside;
    while !rest.is_empty() {
        let mut compound = Vec::new();
        while let Some((simple, weight, after)) = parse_simple(rest, compound.is_empty(), depth)? {
            for (sum, weight) in selector.specificity.iter_mut().zip(weight) {
                *sum += weight;
            }
            compound.push(simple);
            rest = after;
        }
        if compound.is_empty() || selector.parts.len() == MAX_PARTS {
            return None;
        }
        selector.parts.push((combinator, compound));
        let after = rest.trim_start();
        combinator = match after.chars().next() {
            None => return Some(selector),
            Some('>') => Combinator::Child,
            Some('+') => Combinator::Next,
            Some('~') => Combinator::After,
            Some(_) if after.len() < rest.len() => Combinator::Inside,
            Some(_) => return None,
        };
        rest = if combinator == Combinator::Inside { after } else { after[1..].trim_start() };
    }
    None
}

/// The next simple selector with its weight and what follows it; nothing at the end of a compound, `None` if it is none.
fn parse_simple(text: &str, is_first: bool, depth: usize) -> Option<Option<(Simple, Specificity, &str)>> {
    let found = match text.chars().next() {
        None => return Some(None),
        Some(letter) if letter.is_whitespace() || ">+~".contains(letter) => return Some(None),
        Some('*') if is_first => {
            // In any namespace.
            match text[1..].strip_prefix('|') {
                Some(rest) if !rest.starts_with('*') => {
                    let (name, rest) = name(rest)?;
                    (Simple::Type(name), [0, 0, 1], rest)
                }
                Some(rest) => (Simple::Any, [0; 3], &rest[1..]),
                None => (Simple::Any, [0; 3], &text[1..]),
            }
        }
        Some('#') => {
            let (name, rest) = name(&text[1..])?;
            (Simple::Id(name), [1, 0, 0], rest)
        }
        Some('.') => {
            let (name, rest) = name(&text[1..])?;
            (Simple::Class(name), [0, 1, 0], rest)
        }
        Some('[') => {
            let end = find(&text[1..], &[']']);
            let rest = text[1 + end..].strip_prefix(']')?;
            (attribute_test(&text[1..=end])?, [0, 1, 0], rest)
        }
        Some(':') if text.starts_with("::") => {
            let (_, rest) = name(&text[2..])?;
            let rest = match rest.strip_prefix('(') {
                Some(inside) => inside[find(inside, &[')'])..].strip_prefix(')')?,
                None => rest,
            };
            (Simple::Never, [0, 0, 1], rest)
        }
        Some(':') => {
            let (name, rest) = name(&text[1..])?;
            let (argument, rest) = match rest.strip_prefix('(') {
                Some(inside) => {
                    let end = find(inside, &[')']);
                    (Some(inside[..end].trim()), inside[end..].strip_prefix(')')?)
                }
                None => (None, rest),
            };
            let (simple, weight) = pseudo_class(&name.to_ascii_lowercase(), argument, depth)?;
            (simple, weight, rest)
        }
        Some(_) if is_first => {
            let (name, rest) = name(text)?;
            if rest.starts_with('|') {
                return None;
            }
            (Simple::Type(name), [0, 0, 1], rest)
        }
        Some(_) => return None,
    };
    Some(Some(found))
}

/// The name that begins the text, with its escapes replaced, and what follows it.
fn name(text: &str) -> Option<(String, &str)> {
    let mut name = String::new();
    let mut rest = text;
    while let Some(letter) = rest.chars().next() {
        if let Some(escaped) = rest.strip_prefix('\\') {
            let digits = escaped.chars().take(6).take_while(char::is_ascii_hexdigit).count();
            if digits > 0 {
                let code = u32::from_str_radix(&escaped[..digits], 16).ok()?;
                name.push(char::from_u32(code).filter(|_| code > 0).unwrap_or(char::REPLACEMENT_CHARACTER));
                rest = &escaped[digits..];
                rest = rest.strip_prefix(char::is_whitespace).unwrap_or(rest);
            } else {
                let letter = escaped.chars().next().filter(|letter| *letter != '\n')?;
                name.push(letter);
                rest = &escaped[letter.len_utf8()..];
            }
        } else if letter.is_ascii_alphanumeric() || "-_".contains(letter) || !letter.is_ascii() {
            name.push(letter);
            rest = &rest[letter.len_utf8()..];
        } else {
            break;
        }
    }
    (!name.is_empty()).then_some((name, rest))
}

/// The test between the brackets of an attribute.
fn attribute_test(text: &str) -> Option<Simple> {
    let text = text.trim();
    let (name, rest) = name(text.strip_prefix("*|").or(text.strip_prefix('|')).unwrap_or(text))?;
    let rest = rest.trim();
    if rest.is_empty() {
        let test = Test::Exists;
        return Some(Simple::Attribute { name, test, value: String::new(), ignores_case: false });
    }
    let (test, rest) = [
        ("~=", Test::Word),
        ("|=", Test::Language),
        ("^=", Test::Begins),
        ("$=", Test::Ends),
        ("*=", Test::Contains),
        ("=", Test::Equals),
    ]
    .iter()
    .find_map(|(sign, test)| rest.strip_prefix(sign).map(|rest| (*test, rest.trim_start())))?;
    let (value, rest) = match rest.chars().next()? {
        mark @ ('"' | '\'') => {
            let end = rest[1..].find(mark)? + 1;
            // Strings with escapes are not worth a reader of their own.
            let value = Some(&rest[1..end]).filter(|value| !value.contains('\\'))?;
            (value.to_owned(), &rest[end + 1..])
        }
        _ => self::name(rest)?,
    };
    let ignores_case = match rest.trim() {
        "" | "s" | "S" => false,
        "i" | "I" => true,
        _ => return None,
    };
    Some(Simple::Attribute { name, test, value, ignores_case })
}

fn pseudo_class(name: &str, argument: Option<&str>, depth: usize) -> Option<(Simple, Specificity)> {
    let class = [0, 1, 0];
    let most = |list: &[Selector]| list.iter().map(|one| one.specificity).max().unwrap_or([0; 3]);
    let nth = |a, b, from_end, of_type| Simple::Nth { a, b, from_end, of_type, of: Vec::new() };
    // Lists that skip what is not valid.
    let list = |argument: &str| -> Vec<Selector> {
        let one = |text| parse(text, depth + 1).unwrap_or_else(Selector::unknown);
        listed(argument).into_iter().map(one).collect()
    };
    Some(match (name, argument) {
        ("root", None) => (Simple::Root, class),
        ("empty", None) => (Simple::Empty, class),
        ("link" | "any-link", None) => (Simple::Link, class),
        ("first-child", None) => (nth(0, 1, false, false), class),
        ("last-child", None) => (nth(0, 1, true, false), class),
        ("first-of-type", None) => (nth(0, 1, false, true), class),
        ("last-of-type", None) => (nth(0, 1, true, true), class),
        ("only-child" | "only-of-type", None) => {
            let of_type = name == "only-of-type";
            let both = [false, true].map(|from_end| nth(0, 1, from_end, of_type));
            let only = Selector { parts: vec![(Combinator::Inside, both.into())], specificity: class };
            (Simple::Is(vec![only]), class)
        }
        ("nth-child" | "nth-last-child" | "nth-of-type" | "nth-last-of-type", Some(argument)) => {
            let lower = argument.to_ascii_lowercase();
            let (steps, of) = match lower.find(" of ") {
                Some(at) => (&lower[..at], parse_list(&argument[at + 4..], depth + 1)?),
                None => (&*lower, Vec::new()),
            };
            let (a, b) = steps_of(steps)?;
            let [ids, classes, types] = most(&of);
            let (from_end, of_type) = (name.contains("last"), name.contains("type"));
            (Simple::Nth { a, b, from_end, of_type, of }, [ids, classes + 1, types])
        }
        ("lang", Some(argument)) => {
            let names = listed(argument).into_iter().map(|name| name.trim_matches(['"', '\'']));
            (Simple::Lang(names.map(str::to_ascii_lowercase).collect()), class)
        }
        ("not", Some(argument)) => {
            let inside = parse_list(argument, depth + 1)?;
            let weight = most(&inside);
            (Simple::Not(inside), weight)
        }
        ("is" | "matches" | "-webkit-any" | "-moz-any", Some(argument)) => {
            let inside = list(argument);
            let weight = most(&inside);
            (Simple::Is(inside), weight)
        }
        ("where", Some(argument)) => (Simple::Is(list(argument)), [0; 3]),
        ("has", Some(argument)) => {
            let is_relative = |text: &&str| text.starts_with(['>', '+', '~']);
            if listed(argument).iter().any(is_relative) {
                return Some((Simple::Unknown, class));
            }
            let inside = list(argument);
            let weight = most(&inside);
            (Simple::Has(inside), weight)
        }
        (
            "hover" | "active" | "focus" | "focus-visible" | "focus-within" | "visited" | "target"
            | "checked" | "disabled" | "enabled" | "fullscreen" | "before" | "after" | "first-line"
            | "first-letter" | "selection" | "placeholder-shown" | "autofill" | "modal" | "playing"
            | "paused" | "current" | "past" | "future" | "target-within" | "user-invalid" | "user-valid"
            | "invalid" | "valid" | "required" | "optional" | "indeterminate" | "default" | "popover-open"
            | "picture-in-picture",
            None,
        ) => (Simple::Never, class),
        _ => (Simple::Unknown, class),
    })
}

/// The steps `an+b`.
fn steps_of(text: &str) -> Option<(i64, i64)> {
    let plain: String = text.chars().filter(|letter| !letter.is_whitespace()).collect();
    let number = |text: &str| text.parse::<i32>().ok().map(i64::from);
    match plain.as_str() {
        "odd" => return Some((2, 1)),
        "even" => return Some((2, 0)),
        _ => {}
    }
    let Some((a, b)) = plain.split_once('n') else { return Some((0, number(&plain)?)) };
    let a = match a {
        "" | "+" => 1,
        "-" => -1,
        other => number(other)?,
    };
    Some((a, if b.is_empty() { 0 } else { number(b)? }))
}

impl Selector {
    /// A selector of elements that are not known.
    pub(super) fn unknown() -> Self {
        Self { parts: vec![(Combinator::Inside, vec![Simple::Unknown])], specificity: [0; 3] }
    }

    /// Whether it can be evaluated at all, as far as its own words go.
    #[cfg(test)]
    pub(super) fn certainty(&self) -> Truth {
        let is_unknown =
            self.parts.iter().flat_map(|(_, simple)| simple).any(|simple| matches!(simple, Simple::Unknown));
        if is_unknown { Truth::Unknown } else { Truth::Yes }
    }

    /// Whether the selector selects an element.
    pub(super) fn matches(&self, node: Node<'_, '_>, steps: &Steps) -> Truth {
        self.matches_to(self.parts.len(), node, steps)
    }

    /// Whether the first `count` compounds match with the last of them at an element.
    fn matches_to(&self, count: usize, node: Node<'_, '_>, steps: &Steps) -> Truth {
        let Some((combinator, compound)) = count.checked_sub(1).and_then(|last| self.parts.get(last)) else {
            return Truth::Yes;
        };
        if !steps.step() {
            return Truth::No;
        }
        let own = compound.iter().map(|simple| simple.matches(node, steps)).min().unwrap_or(Truth::No);
        if own == Truth::No || count == 1 {
            return own;
        }
        let one = |at: Option<Node<'_, '_>>| at.map_or(Truth::No, |at| self.matches_to(count - 1, at, steps));
        let mut best = Truth::No;
        let mut at = node;
        let before = match combinator {
            Combinator::Child => one(node.parent_element()),
            Combinator::Next => one(node.prev_sibling_element()),
            Combinator::Inside | Combinator::After => {
                let next = |at: Node<'_, '_>| match combinator {
                    Combinator::Inside => at.parent_element().map(|at| at.id()),
                    _ => at.prev_sibling_element().map(|at| at.id()),
                };
                while let Some(next) = next(at).and_then(|id| node.document().get_node(id)) {
                    best = best.max(self.matches_to(count - 1, next, steps));
                    if best == Truth::Yes {
                        break;
                    }
                    at = next;
                }
                best
            }
        };
        own.min(before)
    }
}

impl Simple {
    fn matches(&self, node: Node<'_, '_>, steps: &Steps) -> Truth {
        if !steps.step() {
            return Truth::No;
        }
        let any = |list: &[Selector], node| {
            list.iter().map(|selector| selector.matches(node, steps)).max().unwrap_or(Truth::No)
        };
        match self {
            Self::Any => Truth::Yes,
            Self::Type(name) => (node.tag_name().name() == name).into(),
            Self::Id(id) => (attribute(node, "id") == Some(id)).into(),
            Self::Class(class) => {
                let classes = attribute(node, "class").unwrap_or_default();
                classes.split_ascii_whitespace().any(|one| one == class).into()
            }
            Self::Attribute { name, test, value, ignores_case } => {
                let Some(found) = node.attribute(name.as_str()) else { return Truth::No };
                match ignores_case {
                    true => test.holds(&found.to_ascii_lowercase(), &value.to_ascii_lowercase()),
                    false => test.holds(found, value),
                }
                .into()
            }
            Self::Root => node.parent_element().is_none().into(),
            Self::Empty => {
                let is_content = |child: &Node<'_, '_>| child.is_element() || child.is_text();
                (!node.children().any(|child| is_content(&child))).into()
            }
            Self::Link => {
                let has_link = node.attributes().any(|attribute| attribute.name() == "href");
                (node.tag_name().name() == "a" && has_link).into()
            }
            Self::Lang(names) => {
                let language = |node: Node<'_, '_>| {
                    node.attributes()
                        .find(|attribute| attribute.name() == "lang")
                        .map(|attribute| attribute.value().to_ascii_lowercase())
                };
                let own = node.ancestors().find_map(language).unwrap_or_default();
                names.iter().any(|name| Test::Language.holds(&own, name)).into()
            }
            Self::Not(list) => any(list, node).not(),
            Self::Is(list) => any(list, node),
            Self::Has(list) => {
                let mut best = Truth::No;
                for inside in node.descendants().skip(1).filter(Node::is_element) {
                    if !steps.step() {
                        return Truth::No;
                    }
                    best = best.max(any(list, inside));
                    if best == Truth::Yes {
                        break;
                    }
                }
                best
            }
            Self::Nth { a, b, from_end, of_type, of } => {
                let mut own = if of.is_empty() { Truth::Yes } else { any(of, node) };
                let mut place: i64 = 1;
                let mut at = node;
                let next = |at: Node<'_, '_>| {
                    let next = if *from_end { at.next_sibling_element() } else { at.prev_sibling_element() };
                    next.map(|next| next.id())
                };
                while let Some(next) = next(at).and_then(|id| node.document().get_node(id)) {
                    if !steps.step() {
                        return Truth::No;
                    }
                    at = next;
                    if *of_type && at.tag_name() != node.tag_name() {
                        continue;
                    }
                    match if of.is_empty() { Truth::Yes } else { any(of, at) } {
                        Truth::Yes => place += 1,
                        Truth::No => {}
                        Truth::Unknown => own = own.min(Truth::Unknown),
                    }
                }
                let steps = place - b;
                let is_there = match *a {
                    0 => steps == 0,
                    a => steps % a == 0 && steps / a >= 0,
                };
                if own == Truth::Unknown { own } else { own.min(is_there.into()) }
            }
            Self::Never => Truth::No,
            Self::Unknown => Truth::Unknown,
        }
    }
}

impl Test {
    fn holds(self, found: &str, value: &str) -> bool {
        match self {
            Self::Exists => true,
            Self::Equals => found == value,
            Self::Word => found.split_ascii_whitespace().any(|word| word == value),
            Self::Language => {
                found.strip_prefix(value).is_some_and(|rest| rest.is_empty() || rest.starts_with('-'))
            }
            Self::Begins => !value.is_empty() && found.starts_with(value),
            Self::Ends => !value.is_empty() && found.ends_with(value),
            Self::Contains => !value.is_empty() && found.contains(value),
        }
    }
}

#[cfg(test)]
mod tests {
    use roxmltree::Document;

    use super::*;

    /// The ids of the elements that the selector selects for certain, and of those that it may select.
    fn selected(selector: &str) -> (String, String) {
        let text = "<svg id='r' xml:lang='de-AT'><g id='a' class='x y'><p id='b' d='Some'/><p id='c'/><q id='d'/>\
                    <p id='e' href='#'/></g><g id='f'><a id='h' href='#'/></g></svg>";
        let document = Document::parse(text).unwrap();
        let steps = Steps::default();
        let list = parsed(selector);
        let of = |expected: Truth| {
            let elements = document.descendants().filter(Node::is_element);
            let best = |node| list.iter().map(|one| one.matches(node, &steps)).max().unwrap();
            elements.filter(|node| best(*node) == expected).filter_map(|node| attribute(node, "id")).collect()
        };
        (of(Truth::Yes), of(Truth::Unknown))
    }

    #[test]
    fn elements_are_those_of_the_standard() {
        for (selector, expected) in [
            ("*", "rabcdefh"),
            ("p", "bce"),
            ("P", ""),
            ("#c, q", "cd"),
            ("g.x.y", "a"),
            (".x p", "bce"),
            ("svg > p", ""),
            ("g>p", "bce"),
            ("p + p", "c"),
            ("p ~ p", "ce"),
            ("p~q", "d"),
            ("[d]", "b"),
            ("[d=Some]", "b"),
            ("[d='some']", ""),
            ("[d=some i]", "b"),
            ("[d^=\"So\"]", "b"),
            ("[d$=me]", "b"),
            ("[d*='om']", "b"),
            ("[d*='']", ""),
            ("[class~=y]", "a"),
            (":root", "r"),
            ("p:not(#b)", "ce"),
            (":not(p, g, svg)", "dh"),
            (":is(p, q):first-child", "b"),
            (":where(g) > :last-child", "eh"),
            ("p:nth-child(2)", "c"),
            ("g > :nth-child(2n+1)", "bdh"),
            ("g > :nth-child( odd )", "bdh"),
            ("p:nth-last-child(-n+2)", "e"),
            ("p:nth-of-type(3)", "e"),
            (":nth-child(2 of p)", "c"),
            ("g :only-child", "h"),
            ("q:only-of-type", "d"),
            ("g:has(q)", "a"),
            ("p:empty:lang(de)", "bce"),
            (":link", "h"),
            ("p:hover, p::before", ""),
            ("\\70, #\\62 ", "bce"),
            ("*|p", "bce"),
        ] {
            assert_eq!(selected(selector), (expected.into(), String::new()), "{selector}");
        }
        for (selector, unknown) in [
            ("p:what", "bce"),
            ("p:not(:what)", "bce"),
            ("q:is(:what, p)", "d"),
            ("p,,q", "rabcdefh"),
            ("p > > q", "rabcdefh"),
            ("p:nth-child(x)", "rabcdefh"),
            ("svg|p", "rabcdefh"),
            ("g:has(> q)", "af"),
        ] {
            assert_eq!(selected(selector), (String::new(), unknown.into()), "{selector}");
        }
    }

    #[test]
    fn specificities_are_those_of_the_standard() {
        // The examples of Selectors Level 4, chapter 17.
        for (selector, expected) in [
            ("*", [0, 0, 0]),
            ("li", [0, 0, 1]),
            ("ul li", [0, 0, 2]),
            ("ul ol+li", [0, 0, 3]),
            ("ul ol li.red", [0, 1, 3]),
            ("li.red.level", [0, 2, 1]),
            ("#x34y", [1, 0, 0]),
            ("#s12:not(foo)", [1, 0, 1]),
            (".foo :is(.bar, #baz)", [1, 1, 0]),
            (":nth-child(even of li, .item)", [0, 2, 0]),
            (".qux:where(em, #foo#bar#baz)", [0, 1, 0]),
        ] {
            assert_eq!(parsed(selector)[0].specificity, expected, "{selector}");
        }
    }
}
