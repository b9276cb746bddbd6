//! Which drawings are for other lines.

use serde::Deserialize;
use toml::Spanned;

use super::error::ConfigError;
use super::fleet::FleetSettings;
use super::sku::{Sku, fold};
use super::text::SettingsText;

/// The most rules of a station.
const MOST: usize = 1000;
/// The longest pattern, characters.
const LONGEST: usize = 255;

/// A rule: drawings of these names are for this line.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct Route {
    /// The pattern for the SKU; `None` for any.
    pub sku: Option<String>,
    /// The pattern for the name of the drawing; `None` for any.
    pub name: Option<String>,
    /// The line: a station, or a group of stations.
    pub line: String,
}

impl Route {
    /// Whether the rule is for a drawing of this name.
    #[must_use]
    pub fn is_for(&self, sku: &Sku, name: &str) -> bool {
        let fits = |pattern: &Option<String>, text: &str| {
            pattern.as_ref().is_none_or(|pattern| matches(&fold(pattern), text))
        };
        fits(&self.sku, sku.key()) && fits(&self.name, &fold(name))
    }
}

/// Whether a text has the form of a pattern, in which `*` is any text and `?` any character.
fn matches(pattern: &str, text: &str) -> bool {
    let (pattern, text): (Vec<char>, Vec<char>) = (pattern.chars().collect(), text.chars().collect());
    let (mut at, mut of) = (0, 0);
    // After the last `*`: its place, and how much of the text it takes.
    let mut star: Option<(usize, usize)> = None;
    while at < text.len() {
        match pattern.get(of) {
            Some('*') => {
                star = Some((of, at));
                of += 1;
            }
            Some(c) if *c == '?' || *c == text[at] => (at, of) = (at + 1, of + 1),
            _ => {
                let Some((place, taken)) = star else { return false };
                star = Some((place, taken + 1));
                (of, at) = (place + 1, taken + 1);
            }
        }
    }
    pattern[of..].iter().all(|c| *c == '*')
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct RouteKeys {
    rules: Option<Spanned<Vec<RuleKeys>>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RuleKeys {
    #[serde(default)]
    sku: Option<Spanned<String>>,
    #[serde(default)]
    name: Option<Spanned<String>>,
    line: Spanned<String>,
}

impl RouteKeys {
    pub(super) fn check(
        self,
        text: &SettingsText,
        fleet: Option<&FleetSettings>,
    ) -> Result<Vec<Route>, ConfigError> {
        let Some(rules) = self.rules else { return Ok(Vec::new()) };
        let span = rules.span();
        let wrong = |span: &std::ops::Range<usize>, what: String, remedy: String| {
            ConfigError::Contradiction { spot: text.spot(span), what, remedy }
        };
        if fleet.is_none() && !rules.get_ref().is_empty() {
            let remedy = "Give `url` under [fleet], or remove the rules.";
            return Err(wrong(&span, "`route.rules` needs a fleet.".into(), remedy.into()));
        }
        if rules.get_ref().len() > MOST {
            return Err(wrong(
                &span,
                format!("`route.rules` has more than {MOST} rules."),
                "Give fewer.".into(),
            ));
        }
        let mut routes = Vec::new();
        for rule in rules.into_inner() {
            for pattern in [&rule.sku, &rule.name].into_iter().flatten() {
                let length = pattern.get_ref().chars().count();
                if length == 0 || length > LONGEST {
                    let what = format!("A pattern of `route.rules` has {length} characters.");
                    return Err(wrong(&pattern.span(), what, format!("Give 1 to {LONGEST} characters.")));
                }
            }
            if rule.sku.is_none() && rule.name.is_none() {
                let remedy = "Add `sku` or `name`, such as `sku = \"mug-*\"`.";
                let what = "A rule of `route.rules` has no pattern.".to_owned();
                return Err(wrong(&rule.line.span(), what, remedy.into()));
            }
            if !FleetSettings::is_name(rule.line.get_ref()) {
                let what = "`line` in `route.rules` is not a name for a line.".to_owned();
                return Err(wrong(&rule.line.span(), what, FleetSettings::name_remedy()));
            }
            let [sku, name] = [rule.sku, rule.name].map(|pattern| pattern.map(Spanned::into_inner));
            routes.push(Route { sku, name, line: rule.line.into_inner() });
        }
        Ok(routes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_match_as_in_a_shell_in_any_case() {
        for (pattern, text, expected) in [
            ("*", "", true),
            ("mug-*", "mug-12", true),
            ("mug-*", "Mug", false),
            ("m?g", "mug", true),
            ("m?g", "mg", false),
            ("*@gift*.dxf", "can@gift-2.dxf", true),
            ("*@gift*.dxf", "can@gift-2.dxfx", false),
            ("a*b*c", "aXbYbZc", true),
            ("a*b*c", "aXbYbZ", false),
            ("", "a", false),
            ("a**", "a", true),
        ] {
            assert_eq!(matches(pattern, text), expected, "{pattern} {text}");
        }
        // A pattern with many stars takes no exponential time.
        assert!(!matches(&"*a".repeat(120), &"a".repeat(119)));
        let rule = Route { sku: Some("MUG*".into()), name: Some("*@Gift*".into()), line: "a".into() };
        let sku = |name: &str| name.parse::<Sku>().unwrap();
        assert!(rule.is_for(&sku("Mug 3"), "Mug 3@GIFT.svg"));
        assert!(!rule.is_for(&sku("Mug 3"), "Mug 3@date.svg"));
        assert!(!rule.is_for(&sku("can"), "can@gift.svg"));
    }
}
