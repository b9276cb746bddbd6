//! `isomark correct --list`: one corrected drawing for each row of a list.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use super::job::Job;
use super::named_files::{apart, file_trouble, name_of, read_file, tell_of_stale, write_file, write_file_if};
use super::outcome::{Failure, Outcome, print_json, tell};
use crate::config::BadRows;
use crate::formats::list::{LeftOut, List, Product, Row};
use crate::pipeline::{ListJob, PatternInput, PipelineError};
use crate::reason::{Reason, Severity};
use crate::report::ListReport;

/// Most different warnings that are reported: those of single rows could be many.
const MOST_WARNINGS: usize = 50;
/// Least digits of the number in the names of the drawings.
const DIGITS: usize = 4;

/// Writes the drawing of every row into `folder`, as `<list>-0001.dxf` and so on; `read` are the files that the job is from.
pub(super) fn run(job: &Job, list: &Path, read: &[&Path], folder: &Path, is_json: bool) -> Outcome {
    let bytes = read_file(list)?;
    let (file, stem) = (name_of(list)?, list.file_stem().unwrap_or_default().to_string_lossy().into_owned());
    fs_err::create_dir_all(folder).map_err(|error| file_trouble("create", folder, &error))?;
    let date = job.settings.content.values.date.map(|date| date.to_string());
    let report = ListReport::new(job.sku.as_str(), &file, &name_of(job.pattern)?, date);
    let list = ListJob::new(&file, &job.sku, &job.drawing, &job.settings, 0);
    let mut listed = Listed { job, list, report, warned: BTreeSet::new() };
    let mut left_out = BTreeSet::new();
    let mut rows = 0u64;
    let rows_of =
        |list: &ListJob| List::new(&bytes).map_err(|error| Failure::rejected(list.unreadable(&error)));
    for (row, index) in rows_of(&listed.list)?.zip(0..) {
        rows = index + 1;
        let checked = row.map_err(|error| listed.list.unreadable(&error));
        if let Err(reason) = checked.and_then(|row| listed.list.check(&row)) {
            listed.leave_out(reason, index)?;
            left_out.insert(index);
        }
    }
    if rows == left_out.len() as u64 {
        return Err(Failure::rejected(listed.list.empty()));
    }
    let digits = DIGITS.max(rows.ilog10() as usize + 1);
    let out = |number: u64| folder.join(format!("{stem}-{number:0digits$}.dxf"));
    for (row, index) in rows_of(&listed.list)?.zip(0..) {
        let file = row.ok().filter(|_| !left_out.contains(&index)).map(|row| out(row.number));
        if let Some(file) = file.filter(|file| file.exists()) {
            apart(read, &[("--out-dir", &file)])?;
        }
    }
    for (row, index) in rows_of(&listed.list)?.zip(0..) {
        let Some(row) = row.ok().filter(|_| !left_out.contains(&index)) else { continue };
        let out = out(row.number);
        match listed.write(&out, &row) {
            Ok(()) => listed.note(row, &out)?,
            Err(WriteError::Failed(failure)) => return Err(failure),
            Err(WriteError::Rejected(reason)) => {
                let written = listed.report.rows.len();
                if job.settings.content.bad_rows == BadRows::Refuse && written > 0 {
                    let drawings = if written == 1 { "1 drawing" } else { &format!("{written} drawings") };
                    tell(&format!("{drawings} of the rows before row {} are in the folder", row.number));
                }
                listed.leave_out(listed.list.refused(&row, reason), index)?;
                left_out.insert(index);
            }
        }
    }
    // Those of an earlier, longer list would be marked again.
    let written: BTreeSet<&str> = listed.report.rows.iter().map(|row| row.drawing.as_str()).collect();
    tell_of_stale(folder, |name| {
        let number = name.strip_prefix(&stem).and_then(|rest| rest.strip_prefix('-')?.strip_suffix(".dxf"));
        let is_number = |text: &str| text.len() >= DIGITS && text.bytes().all(|byte| byte.is_ascii_digit());
        number.is_some_and(is_number) && !written.contains(name)
    });
    let drawings = match listed.report.rows.len() {
        1 => "1 drawing".to_owned(),
        written => format!("{written} drawings"),
    };
    let without = match left_out.len() {
        0 => String::new(),
        1 => "; 1 row is left out".to_owned(),
        many => format!("; {many} rows are left out"),
    };
    tell(&format!("{file}: {drawings} in {}{without}", folder.display()));
    if is_json {
        let json = listed.report.to_json().map_err(|error| Failure::environment(&error.into()))?;
        print_json(&json);
    }
    Ok(())
}

struct Listed<'j> {
    job: &'j Job<'j>,
    list: ListJob<'j>,
    report: ListReport,
    /// The warnings that were reported.
    warned: BTreeSet<String>,
}

enum WriteError {
    Rejected(Reason),
    Failed(Failure),
}

impl Listed<'_> {
    fn write(&mut self, out: &Path, row: &Row) -> Result<(), WriteError> {
        let settings = &self.list.settings_of(row).map_err(WriteError::Rejected)?;
        let Job { sku, pipeline, learned, pattern, drawing, verify, .. } = self.job;
        let name = name_of(pattern).map_err(WriteError::Failed)?;
        let input = PatternInput { name: &name, bytes: drawing, previous: None };
        let mut corrected = match pipeline.correct(sku, learned, input, settings, false) {
            Ok(corrected) => corrected,
            Err(PipelineError::Rejected(reason)) => return Err(WriteError::Rejected(reason)),
            Err(error) => return Err(WriteError::Failed(error.into())),
        };
        for notice in corrected.report.notices.iter().filter(|notice| notice.severity == Severity::Warning) {
            // What all drawings have in common is reported once.
            if self.warned.len() < MOST_WARNINGS && self.warned.insert(notice.message.clone()) {
                tell(&format!("row {}: warning: {}", row.number, notice.message));
            }
        }
        let dxf = std::mem::take(&mut corrected.dxf);
        let written = match corrected.is_to_be_read_back(*verify) {
            true => write_file_if(out, &dxf, |file| corrected.read_back(file)),
            false => write_file(out, &dxf),
        };
        written.map_err(WriteError::Failed)
    }

    /// Adds a row whose drawing is written to the report.
    fn note(&mut self, row: Row, out: &Path) -> Outcome {
        if let Some(serial) = self.list.serial(row.number) {
            self.report.add(&Product { row, serial }, name_of(out)?);
        }
        Ok(())
    }

    /// Reports a row that is not marked, with its serial number; or ends with its reason.
    fn leave_out(&mut self, reason: Reason, index: u64) -> Outcome {
        if self.job.settings.content.bad_rows == BadRows::Refuse {
            return Err(Failure::rejected(reason));
        }
        tell(&reason.to_string());
        let left_out = LeftOut { serial: self.list.serial(index + 1), reason };
        self.report.leave_out(&left_out);
        if let Some(number) = left_out.serial {
            tell(&format!("the serial number {number} will not be used: its row is left out"));
        }
        Ok(())
    }
}

/// Where the drawings of a list go.
pub(super) fn folder(list: &Path, given: Option<&PathBuf>) -> Result<PathBuf, Failure> {
    given.cloned().ok_or_else(|| {
        Failure::usage(
            format!(
                "`--list {}` writes a drawing for each row, and no folder is given for them.",
                list.display()
            ),
            "Name the folder with `--out-dir`.",
        )
    })
}
