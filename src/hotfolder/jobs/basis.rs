//! What a delivered drawing was made of besides its pattern: by it a drawing is known to be outdated.

use crate::config::{JobSettings, canonical};

/// The basis of a drawing that is made of a part, under its [identity](crate::hotfolder::Corrector::part_identity), with these
/// settings. The program's version is left out: a new one outdates nothing.
pub(crate) fn basis(part: &str, settings: &JobSettings) -> String {
    let text = format!("{part}\n{}", canonical::drawing(settings));
    format!("{}{}", form(), &blake3::hash(text.as_bytes()).to_hex()[..32])
}

/// The basis of a drawing of which nobody knows what part it was made of: whatever it would be made of today is another one.
pub(crate) fn of_unknown_part() -> String {
    format!("{}unknown", form())
}

/// Whether a basis has the form that [`basis`] gives it, so that one that differs stands for a drawing that is outdated.
/// Older versions wrote a bare hash.
pub(crate) fn is_comparable(basis: &str) -> bool {
    basis.starts_with(&form())
}

fn form() -> String {
    format!("v{}:", canonical::VERSION)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::canonical::tests::everything;

    /// A change here makes every station deliver its whole archive again, if it is set up to correct what is outdated.
    #[test]
    fn the_basis_of_a_drawing_is_pinned() {
        // BLAKE3 by another program: of "ab12", a new line and the pinned text of the settings.
        let usual = basis("ab12", &JobSettings::default());
        assert_eq!(usual, "v2:473135cea57ca503e0d956de7fc0b43d");
        assert_eq!(basis("ab12", &everything()), "v2:c7b83a88fb37c3df8ecf2205279ac9a6");
        assert_ne!(basis("ab13", &JobSettings::default()), usual);
        assert!(is_comparable(&of_unknown_part()));
        assert!(is_comparable(&usual) && !is_comparable(&usual[3..]) && !is_comparable(""));
    }
}
