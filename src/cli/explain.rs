//! `isomark explain`: what a code of a reason or notice means, and what to do about it.

use clap::Args;
use serde::Serialize;

use super::outcome::{Failure, Outcome, print, print_json};
use crate::config::near;
use crate::reason::{Code, CodeKind};

/// Columns of the printed text.
const WIDTH: usize = 80;
/// Similar codes that are named for an unknown one.
const MOST_SIMILAR: usize = 3;
/// Name and version of the JSON form.
const SCHEMA: &str = "isomark.codes/1";

#[derive(Debug, Args)]
pub(super) struct ExplainArguments {
    /// The code, such as `mesh-truncated`; without it, all codes are listed.
    code: Option<String>,
    /// Prints the code, or all codes, as JSON.
    #[arg(long)]
    pub(super) json: bool,
}

#[derive(Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) struct Document {
    /// [`SCHEMA`].
    schema: &'static str,
    /// The codes, sorted.
    codes: &'static [Code],
}

pub(super) fn run(arguments: &ExplainArguments) -> Outcome {
    let codes = match &arguments.code {
        Some(given) => std::slice::from_ref(entry(given)?),
        None => Code::ALL,
    };
    if arguments.json {
        let json = serde_json::to_string_pretty(&Document { schema: SCHEMA, codes })
            .map_err(|error| Failure::environment(&error.into()))?;
        print_json(&(json + "\n"));
        return Ok(());
    }
    print(&match codes {
        [code] => explanation(code),
        codes => list(codes),
    });
    Ok(())
}

fn entry(given: &str) -> Result<&'static Code, Failure> {
    let given = given.trim().to_lowercase();
    Code::named(&given).ok_or_else(|| {
        let names: Vec<&str> = Code::ALL.iter().map(|code| code.code).collect();
        let similar = near(&given, &names).into_iter().take(MOST_SIMILAR);
        let similar: Vec<String> = similar.map(|name| format!("`{name}`")).collect();
        let meant = match similar[..] {
            [] => String::new(),
            _ => format!("Did you mean {}? ", similar.join(" or ")),
        };
        let remedy = format!("{meant}`isomark explain` lists all codes.");
        Failure::usage(format!("There is no code `{given}`."), remedy)
    })
}

fn explanation(code: &Code) -> String {
    let kind = match code.kind {
        CodeKind::Reason => "reason",
        CodeKind::Notice => "notice",
        CodeKind::Both => "reason or notice",
    };
    let remedy = format!("What to do: {}", code.remedy);
    let paragraphs = [code.meaning, code.explanation, &remedy].map(|text| wrapped(text, 0, 0));
    format!("{} ({kind})\n\n{}", code.code, paragraphs.join("\n"))
}

fn list(codes: &[Code]) -> String {
    let widest = codes.iter().map(|code| code.code.len()).max().unwrap_or(0);
    let sections = CodeKind::ALL.iter().map(|kind| {
        let lines = codes.iter().filter(|code| code.kind == *kind).map(|Code { code, meaning, .. }| {
            format!("  {code:<widest$}  {}", wrapped(meaning, widest + 4, widest + 4))
        });
        format!("{}\n\n{}", kind.title(), lines.collect::<String>())
    });
    sections.collect::<Vec<_>>().join("\n")
}

/// The words in lines of at most [`WIDTH`] columns, the first of which begins in column `start`, the others in `indent`.
fn wrapped(text: &str, start: usize, indent: usize) -> String {
    let (mut lines, mut column) = (String::new(), start);
    for (index, word) in text.split(' ').enumerate() {
        let width = word.chars().count();
        if index > 0 && column + 1 + width > WIDTH {
            lines += &format!("\n{:indent$}", "");
            column = indent;
        } else if index > 0 {
            lines.push(' ');
            column += 1;
        }
        lines += word;
        column += width;
    }
    lines + "\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_end_before_the_width_and_lose_no_word() {
        let text = "word ".repeat(60);
        let lines = wrapped(text.trim_end(), 10, 4);
        assert!(lines.lines().skip(1).all(|line| line.len() <= WIDTH && line.starts_with("    word")));
        assert!(lines.lines().next().unwrap().len() <= WIDTH - 10);
        assert_eq!(lines.split_whitespace().count(), 60);
    }
}
