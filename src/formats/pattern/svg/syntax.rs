//! What selectors and style sheets have in common: blocks in text, and what cannot be evaluated (CSS Syntax Level 3).

/// Whether something holds; the smaller one of two if both must hold, the larger one if one of them must.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Truth {
    No,
    Unknown,
    Yes,
}

impl Truth {
    pub(super) fn not(self) -> Self {
        match self {
            Self::No => Self::Yes,
            Self::Unknown => Self::Unknown,
            Self::Yes => Self::No,
        }
    }
}

impl From<bool> for Truth {
    fn from(holds: bool) -> Self {
        if holds { Self::Yes } else { Self::No }
    }
}

/// Where the first of these signs is that is in no string, function or block inside the text, or the end of the text.
pub(super) fn find(text: &str, signs: &[char]) -> usize {
    let mut open: Vec<char> = Vec::new();
    let mut letters = text.char_indices();
    while let Some((at, letter)) = letters.next() {
        if open.is_empty() && signs.contains(&letter) {
            return at;
        }
        match letter {
            '\\' => {
                letters.next();
            }
            '"' | '\'' => {
                while let Some((_, inside)) = letters.next() {
                    match inside {
                        '\\' => {
                            letters.next();
                        }
                        // A string ends with its line, even without its mark.
                        '\n' => break,
                        _ if inside == letter => break,
                        _ => {}
                    }
                }
            }
            '(' => open.push(')'),
            '[' => open.push(']'),
            '{' => open.push('}'),
            _ if open.last() == Some(&letter) => {
                open.pop();
            }
            _ => {}
        }
    }
    text.len()
}

/// The parts of a list between commas.
pub(super) fn listed(text: &str) -> Vec<&str> {
    let mut parts = Vec::new();
    let mut rest = text;
    loop {
        let end = find(rest, &[',']);
        parts.push(rest[..end].trim());
        match rest[end..].strip_prefix(',') {
            Some(after) => rest = after,
            None => return parts,
        }
    }
}
