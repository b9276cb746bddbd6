//! Why the fleet cannot be used.

use std::error::Error as _;

use tokio_postgres::error::SqlState;

use crate::config::near;
use crate::printable::on_one_line;
use crate::reason::Reason;

/// The longest text of a server that is repeated in a message, characters.
const LONGEST: usize = 300;

/// Why the fleet cannot be used. No message contains a password.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum FleetError {
    /// The URL cannot be used.
    #[error("The URL of the fleet cannot be used: {0}.")]
    Url(String),
    /// The password cannot be read.
    #[error("The password for the fleet cannot be read: {0}.")]
    Password(String),
    /// The certificates of the authority cannot be read.
    #[error("The certificates for the fleet cannot be read: {0}.")]
    Certificate(String),
    /// The server does not answer, or cannot work now.
    #[error("The fleet's database cannot be reached: {0}.")]
    Away(String),
    /// The server refuses the login, or the connection is not as secure as it must be.
    #[error("The fleet's database refuses the connection: {0}.")]
    Refused(String),
    /// The login may not do this.
    #[error("The fleet's database does not permit this: {0}.")]
    Rights(String),
    /// The tables are missing or older than this program needs.
    #[error("The fleet's database has tables of version {found}; this isomark needs version {needed}.")]
    Older {
        /// The version of the tables; 0 for none.
        found: i32,
        /// The version that this program makes.
        needed: i32,
    },
    /// The tables are newer than this program knows.
    #[error("The fleet's database has tables of version {found}; this isomark knows versions up to {known}.")]
    Newer {
        /// The version of the tables.
        found: i32,
        /// The version that this program makes.
        known: i32,
    },
    /// A migration in the database differs from the one of the same number in this program.
    #[error("The fleet's database has another migration {0} than this isomark.")]
    Foreign(i32),
    /// No station of the fleet has this name.
    #[error("No station of the fleet has the name \"{name}\".")]
    UnknownStation {
        /// The name as given.
        name: String,
        /// The names that are known.
        known: Vec<String>,
    },
    /// A station that is to be removed is alive, or has jobs.
    #[error("The station \"{name}\" is still in use.")]
    StationInUse {
        /// Its name.
        name: String,
        /// The jobs that it has taken and that have not ended; 0 if it is alive.
        jobs: i64,
    },
    /// The outbox in the state folder cannot be used.
    #[error("The messages to the fleet cannot be read: {0}.")]
    Outbox(String),
    /// The server refuses a statement.
    #[error("The fleet's database gave an error: {0}.")]
    Answer(String),
    /// The server refuses a value.
    #[error("The fleet's database does not accept a value: {0}.")]
    Value(String),
}

impl FleetError {
    /// The reason, with what to do.
    #[must_use]
    pub fn reason(&self) -> Reason {
        let what = self.to_string();
        match self {
            Self::Url(_) => Reason::new(
                "fleet-url",
                what,
                "Give the address of the database without a password, such as `postgresql://laser1@db.shop.local/isomark`.",
            ),
            Self::Password(_) => Reason::new(
                "fleet-password",
                what,
                "Write the password on the first line of the file that `password_file` under [fleet] or `--password-file` names.",
            ),
            Self::Certificate(_) => Reason::new(
                "fleet-certificate",
                what,
                "Give the certificates of the authority that signed the server's as a PEM file.",
            ),
            Self::Away(_) => Reason::new(
                "fleet-away",
                what,
                "Check that the server runs and that the network reaches it. Stations work without it and try again.",
            ),
            Self::Refused(_) => Reason::new(
                "fleet-refused",
                what,
                "Check user, password, certificate and the server's pg_hba.conf. For a server without TLS on a trusted network, add \
                 `?sslmode=disable` to the URL.",
            ),
            Self::Rights(_) => Reason::new(
                "fleet-rights",
                what,
                "Give the login its role, such as `GRANT isomark_station TO laser1`; `isomark fleet init` needs the owner of the \
                 database with CREATEROLE.",
            ),
            Self::Older { .. } => {
                Reason::new("fleet-older", what, "Run `isomark fleet init URL` as the owner of the database.")
            }
            Self::Newer { .. } | Self::Foreign(_) => Reason::new(
                "fleet-newer",
                what,
                "Update isomark on this computer. Until then it works without the fleet.",
            ),
            Self::UnknownStation { name, known } => {
                let what = format!("No station of the fleet has the name \"{}\".", on_one_line(name));
                let remedy = match near(name, known).first() {
                    Some(near) => {
                        format!("Did you mean \"{}\"? `isomark fleet status` lists all.", on_one_line(near))
                    }
                    None => {
                        "List them with `isomark fleet status`; a station is known after its first start."
                            .into()
                    }
                };
                Reason::new("fleet-station-unknown", what, remedy)
            }
            Self::StationInUse { name, jobs } => {
                let name = on_one_line(name);
                let (what, remedy) = match jobs {
                    0 => (
                        format!("The station \"{name}\" gave a sign of life in the last 45 s."),
                        "End it first; after a crash, wait for 45 s.".to_owned(),
                    ),
                    _ => (
                        format!("Jobs that the station \"{name}\" has taken have not ended: {jobs}."),
                        format!(
                            "Look at its laser, and put them back with `isomark retry --take-over \"{name}\"`."
                        ),
                    ),
                };
                Reason::new("fleet-station-in-use", what, remedy)
            }
            Self::Outbox(_) => Reason::new(
                "fleet-outbox",
                what,
                "Check that the state folder of the station can be read and written, and that its disk is not full.",
            ),
            Self::Answer(_) | Self::Value(_) => Reason::new(
                "fleet-answer",
                what,
                "Run `isomark fleet check`, and look at the log of the server.",
            ),
        }
    }

    /// Whether the same statement fails each time, because of its values.
    #[must_use]
    pub fn is_final(&self) -> bool {
        matches!(self, Self::Value(_))
    }
}

impl From<tokio_postgres::Error> for FleetError {
    fn from(error: tokio_postgres::Error) -> Self {
        let Some(answer) = error.as_db_error() else {
            // Causes are short texts of the system or of the TLS library.
            let mut text = error.to_string();
            let mut cause = error.source();
            while let Some(inner) = cause {
                text += &format!(": {inner}");
                cause = inner.source();
            }
            let text = shortened(&text);
            // The kinds of the crate are private.
            return match error.to_string() {
                kind if kind.contains("TLS")
                    || kind.contains("authentication")
                    || kind.contains("configuration") =>
                {
                    Self::Refused(text)
                }
                kind if kind.contains("serializing") || kind.contains("column") => Self::Answer(text),
                _ => Self::Away(text),
            };
        };
        let text = shortened(answer.message());
        let code = answer.code();
        // Classes of PostgreSQL, appendix A.
        match (&code.code()[..2], code) {
            (_, code) if *code == SqlState::INSUFFICIENT_PRIVILEGE => Self::Rights(text),
            ("28", _) => Self::Refused(text),
            (_, code) if *code == SqlState::UNDEFINED_DATABASE => Self::Refused(text),
            ("21" | "22" | "23" | "P0", _) => Self::Value(text),
            ("42", _) => Self::Answer(text),
            _ => Self::Away(text),
        }
    }
}

/// A text of the server or of the system for a message: on one line, without the dot at its end.
fn shortened(text: &str) -> String {
    let line: String = on_one_line(text.trim().trim_end_matches('.')).chars().take(LONGEST).collect();
    line
}
