//! A folder in which the program runs.

use std::path::{Path, PathBuf};
use std::time::Duration;

use fs_err as fs;
use serde_json::Value;

use crate::schemas;

/// A path of `tests/data/parts`.
pub fn part(name: &str) -> String {
    format!("{}/tests/data/parts/{name}", env!("CARGO_MANIFEST_DIR"))
}

/// A path of `tests/data/patterns`.
pub fn drawing(name: &str) -> String {
    format!("{}/tests/data/patterns/{name}.dxf", env!("CARGO_MANIFEST_DIR"))
}

/// An empty folder in which the program runs, with its own cache.
pub struct Desk {
    folder: tempfile::TempDir,
}

/// The exit code and the output of a run.
#[derive(Debug)]
pub struct Output {
    pub code: i32,
    pub out: String,
    pub err: String,
}

impl Desk {
    pub fn new() -> Self {
        Self { folder: tempfile::tempdir().unwrap() }
    }

    pub fn path(&self, relative: &str) -> PathBuf {
        self.folder.path().join(relative)
    }

    pub fn root(&self) -> &Path {
        self.folder.path()
    }

    pub fn read(&self, relative: &str) -> Vec<u8> {
        let bytes = fs::read(self.path(relative)).unwrap();
        if schemas::is_document(relative.as_ref()) {
            schemas::document(&bytes);
        }
        bytes
    }

    pub fn text(&self, relative: &str) -> String {
        String::from_utf8(self.read(relative)).unwrap()
    }

    pub fn write(&self, relative: &str, bytes: impl AsRef<[u8]>) {
        let path = self.path(relative);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, bytes).unwrap();
    }

    /// Runs the program to its end.
    pub fn isomark<S: AsRef<str>>(&self, arguments: &[S]) -> Output {
        let cache = self.path("user-cache");
        let finished = assert_cmd::Command::new(env!("CARGO_BIN_EXE_isomark"))
            .args(arguments.iter().map(AsRef::as_ref))
            .current_dir(self.root())
            .env("XDG_CACHE_HOME", &cache)
            .env("LOCALAPPDATA", &cache)
            .env_remove("RUST_LOG")
            .timeout(Duration::from_secs(120))
            .output()
            .unwrap();
        let text = |bytes: &[u8]| String::from_utf8(bytes.to_vec()).unwrap();
        let output = Output {
            code: finished.status.code().unwrap_or(-1),
            out: text(&finished.stdout),
            err: text(&finished.stderr),
        };
        assert!(!output.err.contains('\u{1b}') && !output.out.contains('\u{1b}'), "colour codes: {output:?}");
        assert!(!output.err.contains("panicked"), "{output:?}");
        let asks = |option: &str| arguments.iter().any(|argument| argument.as_ref() == option);
        if asks("--json") && !asks("--help") {
            schemas::document(&output.out);
        }
        output
    }

    /// Corrects a drawing into `out.dxf`, which must succeed, and returns the report.
    pub fn correct(&self, part: &str, pattern: &str, options: &str) -> Value {
        self.correct_to("out.dxf", &[part, pattern], options)
    }

    /// Corrects a drawing into `out`, which must succeed, and returns the report. Options are separated by spaces.
    pub fn correct_to(&self, out: &str, inputs: &[&str], options: &str) -> Value {
        let arguments = [&["correct"], inputs, &["--json", "--out", out]].concat();
        let arguments: Vec<&str> = arguments.into_iter().chain(options.split_whitespace()).collect();
        let output = self.isomark(&arguments);
        assert_eq!(output.code, 0, "{arguments:?}: {}", output.err);
        let report: Value = serde_json::from_str(&output.out).unwrap();
        assert_eq!(report["schema"], "isomark.report/1");
        report
    }
}

impl Drop for Desk {
    fn drop(&mut self) {
        schemas::check_below(self.root());
    }
}

impl Output {
    /// Fails unless the run ended with this code and standard error contains all of these words.
    #[track_caller]
    pub fn refused(&self, code: i32, words: &[&str]) {
        assert_eq!(self.code, code, "{}", self.err);
        for word in words {
            assert!(self.err.contains(word), "`{word}` is missing in:\n{}", self.err);
        }
    }
}

/// The number at a JSON pointer.
#[track_caller]
pub fn number(value: &Value, pointer: &str) -> f64 {
    value
        .pointer(pointer)
        .and_then(Value::as_f64)
        .unwrap_or_else(|| panic!("no number {pointer} in {value:#}"))
}

/// The numbers at a JSON pointer.
#[track_caller]
pub fn numbers(value: &Value, pointer: &str) -> Vec<f64> {
    let list = value.pointer(pointer).and_then(Value::as_array);
    let list = list.unwrap_or_else(|| panic!("no numbers {pointer} in {value:#}"));
    list.iter().map(|number| number.as_f64().unwrap()).collect()
}

/// The codes of the notices.
pub fn notices(report: &Value) -> Vec<&str> {
    report["notices"].as_array().unwrap().iter().map(|notice| notice["code"].as_str().unwrap()).collect()
}

#[track_caller]
pub fn assert_near(found: &[f64], expected: &[f64], within: f64) {
    assert_eq!(found.len(), expected.len());
    let near = found.iter().zip(expected).all(|(a, b)| (a - b).abs() <= within);
    assert!(near, "{found:?} is not {expected:?} within {within}");
}
