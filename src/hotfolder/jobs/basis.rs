//! The basis of a delivered drawing: the part and the settings that it was made from. If the basis changes, the drawing
//! is outdated.

use crate::config::{JobSettings, canonical};

/// The basis of a drawing that is made from a part with this [identity](crate::hotfolder::Corrector::part_identity) and
/// these settings. It does not contain the program's version, so a new version makes no drawing outdated.
pub(crate) fn basis(part: &str, settings: &JobSettings) -> String {
    let text = format!("{part}\n{}", canonical::drawing(settings));
    format!("{}{}", form(), &blake3::hash(text.as_bytes()).to_hex()[..32])
}

/// The basis of a drawing whose part is unknown. It differs from every known basis, so the drawing is outdated.
pub(crate) fn of_unknown_part() -> String {
    format!("{}unknown", form())
}

/// Whether a basis has the current form of [`basis`], so that a different one means that the drawing is outdated. Older
/// versions wrote a hash without a prefix.
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

    /// A change of these hashes makes every station with `outdated = "correct"` deliver its whole archive again.
    #[test]
    fn the_basis_of_a_drawing_is_pinned() {
        // BLAKE3 from another program, of "ab12", a line break and the pinned text of the settings.
        let usual = basis("ab12", &JobSettings::default());
        assert_eq!(usual, "v2:473135cea57ca503e0d956de7fc0b43d");
        assert_eq!(basis("ab12", &everything()), "v2:b8599262a04756f79b5f203540f6c61b");
        assert_ne!(basis("ab13", &JobSettings::default()), usual);
        assert!(is_comparable(&of_unknown_part()));
        assert!(is_comparable(&usual) && !is_comparable(&usual[3..]) && !is_comparable(""));
    }
}
