//! Every code of a [`Reason`](super::Reason) or [`Notice`](super::Notice), with its meaning and what to do.

use serde::Serialize;

/// A code, explained for people. Codes are stable; the texts may change.
///
/// ```
/// use isomark::reason::Code;
///
/// let code = Code::named("mesh-truncated").unwrap();
/// assert_eq!(code.meaning, "The part file is cut off before its end.");
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct Code {
    /// The code, in kebab case.
    pub code: &'static str,
    /// What has this code.
    pub kind: CodeKind,
    /// What it means, as one sentence.
    pub meaning: &'static str,
    /// More about it, with common causes.
    pub explanation: &'static str,
    /// What to do about it.
    pub remedy: &'static str,
}

/// What has a code.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum CodeKind {
    /// Reasons: an input is rejected or waits, or a command fails.
    Reason,
    /// Notices: the job continues, and the report contains the notice.
    Notice,
    /// Reasons and notices, depending on how grave it is or who asks.
    Both,
}

impl Code {
    /// The entry of a code; `None` for a code that isomark does not use.
    #[must_use]
    pub fn named(code: &str) -> Option<&'static Self> {
        Self::ALL.iter().find(|known| known.code == code)
    }
}

impl CodeKind {
    /// All kinds, in the order in which they are listed.
    pub const ALL: &'static [Self] = &[Self::Reason, Self::Notice, Self::Both];

    /// What has such a code, and what that means.
    #[must_use]
    pub const fn title(self) -> &'static str {
        match self {
            Self::Reason => "Reasons: an input is rejected or waits, or a command fails",
            Self::Notice => "Notices: the job continues, and the report contains the notice",
            Self::Both => "Reasons or notices, depending on how grave it is",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_entry_is_complete_and_at_its_place() {
        assert!(Code::ALL.is_sorted_by(|one, next| one.code < next.code));
        for Code { code, meaning, explanation, remedy, .. } in Code::ALL {
            for text in [meaning, explanation, remedy] {
                let is_sentence = text.ends_with('.') && text.trim() == *text && !text.contains("  ");
                assert!(is_sentence, "{code}: {text:?}");
            }
            assert!(meaning.len() <= 110, "{code}: one line, not {}", meaning.len());
        }
    }
}
