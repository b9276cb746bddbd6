//! The text of a SKU's file as it was released: two comment lines, and the settings.
//!
//! The first line has the version and the hash of everything below it, so that a later change is noticed without anything but
//! the file itself.

use crate::printable::on_one_line;

/// How the first line begins.
const MARK: &str = "# isomark-release ";

/// The most lines of released settings: stations compare them with those before.
pub(super) const MOST_LINES: usize = 5_000;

/// The text of a file for these settings; `about` is who released them, when, for whom.
pub(super) fn written(version: i64, about: &str, settings: &str) -> String {
    let rest = format!("# {}\n{settings}", on_one_line(about));
    format!("{MARK}{version} {}\n{rest}", hash(&rest))
}

/// The version and the settings of a text that is exactly as it was released.
pub(super) fn parsed(text: &str) -> Option<(i64, &str)> {
    let (first, rest) = text.split_once('\n')?;
    let (version, its_hash) = first.trim_end().strip_prefix(MARK)?.split_once(' ')?;
    let (_, settings) = rest.split_once('\n')?;
    (its_hash == hash(rest)).then(|| version.parse().ok().map(|version| (version, settings)))?
}

/// The hash of a text; editors and version control change line ends.
pub(super) fn hash(text: &str) -> String {
    blake3::hash(text.replace("\r\n", "\n").as_bytes()).to_hex().to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_change_but_of_line_ends_is_noticed() {
        let settings = "[placement]\nrotation_deg = 90\n";
        let text = written(7, "by Anna\n[optics]", settings);
        assert_eq!(parsed(&text), Some((7, settings)));
        assert_eq!(text.lines().nth(1), Some("# by Anna\\n[optics]"), "a name never becomes a setting");
        assert_eq!(text.lines().nth(2), Some("[placement]"));
        let windows = text.replace('\n', "\r\n");
        assert_eq!(parsed(&windows).map(|(version, _)| version), Some(7));
        for changed in [
            text.replace("90", "91"),
            text.replace("Anna", "Bert"),
            format!("{text}\n"),
            format!("{text}# x"),
            text.trim_end().to_owned(),
            settings.to_owned(),
            text.replacen(MARK, "# isomark ", 1),
            String::new(),
            MARK.to_owned(),
            format!("{MARK}7 x\n"),
        ] {
            assert_eq!(parsed(&changed), None, "{changed}");
        }
        assert_eq!(parsed(&written(1, "", "")), Some((1, "")));
    }
}
