//! The codes in texts: `%%c`, `^I`, and the formats of MTEXT.

use super::super::super::font::composed;
use super::super::code_page::CodePage;

/// Lines under, over and through letters.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Ruled {
    pub(super) under: bool,
    pub(super) over: bool,
    pub(super) through: bool,
}

/// A letter to be drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Letter {
    pub(super) char: char,
    pub(super) ruled: Ruled,
}

impl Letter {
    /// Adds the letter to those before it, or its accent to the last of them.
    pub(super) fn join(self, letters: &mut Vec<Self>) {
        let last = letters.last_mut();
        match last.and_then(|last| Some((composed(last.char, self.char)?, last))) {
            Some((char, last)) => last.char = char,
            None => letters.push(self),
        }
    }
}

/// The letters of a TEXT, with `%%` and `^` codes decoded.
pub(super) fn letters(text: &str, code_page: CodePage) -> Vec<Letter> {
    let mut ruled = Ruled::default();
    let mut letters = Vec::new();
    let text = without_carets(text);
    let mut rest = text.as_str();
    while let Some(first) = rest.chars().next() {
        let (sign, length) = percent(rest, code_page);
        match sign {
            Some(Sign::Letter(char)) => Letter { char, ruled }.join(&mut letters),
            Some(Sign::Under) => ruled.under = !ruled.under,
            Some(Sign::Over) => ruled.over = !ruled.over,
            Some(Sign::Through) => ruled.through = !ruled.through,
            None => Letter { char: first, ruled }.join(&mut letters),
        }
        rest = &rest[if sign.is_some() { length } else { first.len_utf8() }..];
    }
    // Tabs and line ends have no meaning in a single line.
    letters.iter_mut().filter(|letter| letter.char.is_control()).for_each(|letter| letter.char = ' ');
    letters
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Sign {
    Letter(char),
    Under,
    Over,
    Through,
}

/// The meaning of a `%%` code at the beginning of `text`, and its length in bytes.
fn percent(text: &str, code_page: CodePage) -> (Option<Sign>, usize) {
    let Some(code) = text.strip_prefix("%%") else { return (None, 0) };
    let digits = code.bytes().take(3).take_while(u8::is_ascii_digit).count();
    if let Some(number) = code.get(..digits).and_then(|digits| digits.parse::<u16>().ok()) {
        let byte = u8::try_from(number).ok().filter(|byte| *byte >= 32);
        let letter = byte.and_then(|byte| code_page.decode(&[byte]).chars().next());
        return (Some(Sign::Letter(letter.unwrap_or(' '))), 2 + digits);
    }
    let sign = match code.chars().next().map(|letter| letter.to_ascii_lowercase()) {
        Some('c') => Sign::Letter('Ø'),
        Some('d') => Sign::Letter('°'),
        Some('p') => Sign::Letter('±'),
        Some('%') => Sign::Letter('%'),
        Some('u') => Sign::Under,
        Some('o') => Sign::Over,
        Some('k') => Sign::Through,
        _ => return (None, 0),
    };
    (Some(sign), 3)
}

/// Decodes control characters, which are written as a caret and a letter, and the caret, written as a caret and a
/// blank.
fn without_carets(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    let mut letters = text.chars().peekable();
    while let Some(letter) = letters.next() {
        match (letter, letters.peek()) {
            ('^', Some(' ')) => {
                letters.next();
                out.push('^');
            }
            ('^', Some(code @ '@'..='_')) => {
                out.push(char::from(*code as u8 - b'@'));
                letters.next();
            }
            _ => out.push(letter),
        }
    }
    out
}

/// One step through the text of an MTEXT.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Token {
    Letter(char),
    /// A blank at which lines may break.
    Blank,
    Tab,
    Paragraph,
    /// An opening brace: formats that are set inside the braces end with them.
    Open,
    Close,
    /// Stacked letters: upper, lower, and `^`, `/` or `#`.
    Stack(String, String, char),
    Rule(RuleKind, bool),
    /// `\H`: height in units of the drawing, or a factor of the current height.
    Height(Size),
    Width(Size),
    Tracking(Size),
    /// Degrees.
    Oblique(f64),
    /// Vertical position of smaller letters in the line: 0 at its baseline, 1 in the middle, 2 at the top.
    Align(u8),
    Aci(u16),
    Rgb([u8; 3]),
    /// Name, and whether it is the name of a family.
    Font(String, bool),
    /// `\p`: the text up to the semicolon.
    Layout(String),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum RuleKind {
    Under,
    Over,
    Through,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Size {
    Of(f64),
    Times(f64),
}

impl Size {
    pub(super) fn from(self, current: f64) -> f64 {
        match self {
            Self::Of(size) => size,
            Self::Times(factor) => current * factor,
        }
    }
}

/// The text of an MTEXT, code by code (Autodesk, AutoCAD help, "Format codes for alternate text editor"). Codes that
/// are not known are letters.
pub(super) fn tokens(text: &str, code_page: CodePage) -> Vec<Token> {
    let text = without_carets(text);
    let mut tokens = Vec::new();
    let mut rest = text.as_str();
    while let Some(first) = rest.chars().next() {
        let (token, length) = match first {
            '\\' => escape(rest),
            '{' => (Token::Open, 1),
            '}' => (Token::Close, 1),
            ' ' => (Token::Blank, 1),
            '\t' => (Token::Tab, 1),
            '\n' => (Token::Paragraph, 1),
            '%' => match percent(rest, code_page) {
                (Some(Sign::Letter(letter)), length) => (Token::Letter(letter), length),
                _ => (Token::Letter('%'), 1),
            },
            letter => (Token::Letter(letter), letter.len_utf8()),
        };
        if !matches!(token, Token::Letter(letter) if letter.is_control()) {
            tokens.push(token);
        }
        rest = rest.get(length..).unwrap_or_default();
    }
    tokens
}

/// The code at the beginning of `text`, which starts with a backslash, and its length in bytes.
fn escape(text: &str) -> (Token, usize) {
    let Some(code) = text[1..].chars().next() else { return (Token::Letter('\\'), 1) };
    let after = &text[1 + code.len_utf8()..];
    // The argument ends with a semicolon, or with the text.
    let argument = after.split(';').next().unwrap_or_default();
    let whole = 2 + (argument.len() + 1).min(after.len());
    let number = |text: &str| text.trim().parse::<f64>().ok().filter(|number| number.is_finite());
    let size = || match argument.trim().strip_suffix(['x', 'X']) {
        Some(factor) => number(factor).map(|factor| Size::Times(factor.abs())),
        None => number(argument).map(|size| Size::Of(size.abs())),
    };
    let integer = || argument.trim().parse::<u32>().ok();
    let rule = |kind| (Token::Rule(kind, code.is_ascii_uppercase()), 2);
    let token = match code {
        '\\' | '{' | '}' => return (Token::Letter(code), 2),
        '~' => return (Token::Letter('\u{a0}'), 2),
        // The end of a column and a break at a dimension line both begin a new line.
        'P' | 'N' | 'X' => return (Token::Paragraph, 2),
        'L' | 'l' => return rule(RuleKind::Under),
        'O' | 'o' => return rule(RuleKind::Over),
        'K' | 'k' => return rule(RuleKind::Through),
        'S' => return stack(after),
        'H' => size().map(Token::Height),
        'W' => size().map(Token::Width),
        'T' => size().map(Token::Tracking),
        'Q' => number(argument).map(Token::Oblique),
        'A' => integer().and_then(|align| u8::try_from(align).ok()).map(Token::Align),
        'C' => integer().and_then(|aci| u16::try_from(aci).ok()).map(Token::Aci),
        'c' => integer().map(|bgr| {
            let [red, green, blue, _] = bgr.to_le_bytes();
            Token::Rgb([red, green, blue])
        }),
        'f' | 'F' => Some(font(argument)),
        'p' => Some(Token::Layout(argument.into())),
        _ => None,
    };
    token.map_or((Token::Letter('\\'), 1), |token| (token, whole))
}

/// `Arial|b1|i0|c0|p34` or `txt.shx|c0`.
fn font(argument: &str) -> Token {
    let mut parts = argument.split('|');
    let mut name = parts.next().unwrap_or_default().trim().to_owned();
    let is_family = !name.to_lowercase().ends_with(".shx") && !name.is_empty();
    for (mark, word) in [("b1", " Bold"), ("i1", " Italic")] {
        if is_family && parts.clone().any(|part| part.eq_ignore_ascii_case(mark)) {
            name += word;
        }
    }
    Token::Font(name, is_family)
}

/// `1/2;`, `+0.1^-0.2;` or `1#2;`; without one of these signs all letters are the upper ones.
fn stack(after: &str) -> (Token, usize) {
    let (mut upper, mut lower, mut sign) = (String::new(), String::new(), None);
    let mut length = 2;
    let mut letters = after.chars();
    while let Some(mut letter) = letters.next() {
        length += letter.len_utf8();
        match letter {
            ';' => break,
            '^' | '/' | '#' if sign.is_none() => {
                sign = Some(letter);
                continue;
            }
            '\\' => {
                letter = letters.next().unwrap_or(' ');
                length += letter.len_utf8();
            }
            _ => {}
        }
        if sign.is_some() { &mut lower } else { &mut upper }.push(letter);
    }
    (Token::Stack(upper.trim().into(), lower.trim().into(), sign.unwrap_or('^')), length)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plain(text: &str) -> String {
        letters(text, CodePage::WINDOWS_1252).iter().map(|letter| letter.char).collect()
    }

    #[test]
    fn percent_codes_are_decoded() {
        assert_eq!(plain("%%c12%%p0,1 90%%D 5%%% %%065%%246"), "Ø12±0,1 90° 5% Aö");
        assert_eq!(plain("100%% %%x"), "100%% %%x");
        let under: Vec<bool> =
            letters("a%%ub%%uc", CodePage::WINDOWS_1252).iter().map(|l| l.ruled.under).collect();
        assert_eq!(under, [false, true, false]);
        assert_eq!(plain("a^Ib^ c"), "a b^c");
    }

    #[test]
    fn format_codes_of_paragraphs_are_recognised() {
        let found = tokens("{\\fDejaVu Sans|b1|i0;A}\\PB\\H1.5x;\\C1;\\S+1^-2;\\\\", CodePage::WINDOWS_1252);
        let expected = [
            Token::Open,
            Token::Font("DejaVu Sans Bold".into(), true),
            Token::Letter('A'),
            Token::Close,
            Token::Paragraph,
            Token::Letter('B'),
            Token::Height(Size::Times(1.5)),
            Token::Aci(1),
            Token::Stack("+1".into(), "-2".into(), '^'),
            Token::Letter('\\'),
        ];
        assert_eq!(found, expected);
        // Incomplete or unknown codes are read as letters.
        assert_eq!(tokens("\\", CodePage::WINDOWS_1252), [Token::Letter('\\')]);
        assert_eq!(tokens("\\Hx", CodePage::WINDOWS_1252).len(), 3);
        assert_eq!(tokens("\\S1", CodePage::WINDOWS_1252).len(), 1);
    }
}
