//! Why the fleet cannot be used.

use std::error::Error as _;

use tokio_postgres::error::SqlState;

use crate::config::near;
use crate::printable::on_one_line;
use crate::reason::Reason;

/// The longest text of a server that is repeated in a message, characters.
const LONGEST: usize = 300;

/// Why the server refuses a connection.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Refusal {
    /// The user or the password is wrong.
    Password,
    /// The server asks for a password, and none was given.
    NoPassword,
    /// There is no database of this name.
    NoDatabase,
    /// The server does not admit this login from here.
    NotAdmitted,
    /// The server does not encrypt.
    NoTls,
    /// The server's certificate is not valid for its name, or nobody trusts who signed it.
    Certificate,
    /// Another reason.
    Other,
}

impl Refusal {
    /// What to do.
    fn remedy(self) -> &'static str {
        match self {
            Self::Password => {
                "Correct the user in the URL, or the password in the file that `--password-file` or `password_file` under [fleet] names."
            }
            Self::NoPassword => {
                "Give the password with `--password-file FILE`, in the environment variable ISOMARK_FLEET_PASSWORD, or with \
                 `password_file` under [fleet] in the settings of a station."
            }
            Self::NoDatabase => {
                "Correct the name of the database at the end of the URL, or create the database on the server."
            }
            Self::NotAdmitted => {
                "Add a line for this user, database and computer to the server's pg_hba.conf. If it admits only encrypted \
                 connections, put `?sslmode=verify-full` at the end of the URL."
            }
            Self::NoTls => {
                "Set up TLS on the server. Only if it has none and the network is trusted, put `?sslmode=disable` at the end of the URL."
            }
            Self::Certificate => {
                "Name the authority that signed the server's certificate, with `--certificate FILE` or `certificate` under [fleet]; and \
                 write the host in the URL as the certificate names it."
            }
            Self::Other => "Check user, password, certificate and the server's pg_hba.conf.",
        }
    }
}

/// The rights that an action takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Needed {
    /// Those of the owner of the database.
    Owner,
    /// The role of stations.
    Station,
    /// The role of workers.
    Worker,
    /// The role of the office.
    Office,
    /// One of these two roles.
    StationOrOffice,
    /// Any role of the fleet.
    AnyRole,
}

impl Needed {
    /// What to do.
    pub(super) fn remedy(self) -> String {
        let grant = |role: &str, login: &str| {
            format!(
                "As the owner of the database, run `GRANT {role} TO {login}` with the name of the login in place of {login}."
            )
        };
        match self {
            Self::Owner => {
                "Use the login of the owner of the database, who may create roles (CREATEROLE).".into()
            }
            Self::Station => grant("isomark_station", "laser1"),
            Self::Worker => grant("isomark_worker", "cellar"),
            Self::Office => grant("isomark_office", "anna"),
            Self::StationOrOffice => {
                grant("isomark_office", "anna") + " A station's login needs isomark_station."
            }
            Self::AnyRole => {
                grant("isomark_viewer", "anna")
                    + " Stations need isomark_station, workers isomark_worker, and the office isomark_office."
            }
        }
    }
}

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
    #[error("The fleet's database refuses the connection: {what}.")]
    Refused {
        /// The message of the server or of the system.
        what: String,
        /// Why.
        why: Refusal,
    },
    /// The login may not do this.
    #[error("The fleet's database does not permit this: {what}.")]
    Rights {
        /// The message of the server.
        what: String,
        /// The rights that it takes.
        needed: Needed,
    },
    /// The name of the station belongs to another login.
    #[error("The fleet's database does not permit this: {0}.")]
    NameOfAnother(String),
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
    /// The fleet has no fit with this key.
    #[error("The fleet has no fit with the key \"{key}\".")]
    UnknownFit {
        /// The key as given.
        key: String,
    },
    /// A drawing with a list is for a line that a group of stations takes from.
    #[error(
        "A list of products cannot go to the line \"{line}\": it is a group of stations, and each counts its own serial numbers."
    )]
    ListForGroup {
        /// The line.
        line: String,
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
            Self::Refused { why, .. } => Reason::new("fleet-refused", what, why.remedy()),
            Self::Rights { needed, .. } => Reason::new("fleet-rights", what, needed.remedy()),
            Self::NameOfAnother(_) => Reason::new(
                "fleet-rights",
                what,
                "Give the station another `name` under [fleet], or use the login that first used the name. If the station with this name no \
                 longer exists, `isomark fleet prune URL --station NAME` frees the name. A new station has its name after its first start.",
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
            Self::UnknownFit { key } => {
                let what = format!("The fleet has no fit with the key \"{}\".", on_one_line(key));
                let remedy = "Give the 32 digits of the key, as the log of a station names it. A fit that was removed before is gone.";
                Reason::new("fleet-fit-unknown", what, remedy)
            }
            Self::ListForGroup { line } => {
                let what = format!(
                    "A list of products cannot go to the line \"{}\": it is a group of stations, and each counts its own serial numbers.",
                    on_one_line(line)
                );
                let remedy = "Send the drawing with its list to one station, by the name of the station.";
                Reason::new("list-for-group", what, remedy)
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
        matches!(self, Self::Value(_) | Self::ListForGroup { .. })
    }

    /// The same error, of an action that takes these rights.
    pub(super) fn needing(self, needed: Needed) -> Self {
        match self {
            Self::Rights { what, .. } => Self::Rights { what, needed },
            error => error,
        }
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
                    Self::Refused { why: refusal_of(&text), what: text }
                }
                kind if kind.contains("serializing") || kind.contains("column") => Self::Answer(text),
                _ => Self::Away(text),
            };
        };
        let text = shortened(answer.message());
        let code = answer.code();
        // Classes of PostgreSQL, appendix A.
        match (code.code().get(..2).unwrap_or_default(), code) {
            // The text is that of our own functions.
            (_, code)
                if *code == SqlState::INSUFFICIENT_PRIVILEGE && text.starts_with("the station name ") =>
            {
                Self::NameOfAnother(text)
            }
            (_, code) if *code == SqlState::INSUFFICIENT_PRIVILEGE => {
                Self::Rights { what: text, needed: Needed::AnyRole }
            }
            (_, code) if *code == SqlState::INVALID_PASSWORD => {
                Self::Refused { what: text, why: Refusal::Password }
            }
            ("28", _) => Self::Refused { what: text, why: Refusal::NotAdmitted },
            (_, code) if *code == SqlState::UNDEFINED_DATABASE => {
                Self::Refused { what: text, why: Refusal::NoDatabase }
            }
            ("21" | "22" | "23" | "P0", _) => Self::Value(text),
            ("42", _) => Self::Answer(text),
            _ => Self::Away(text),
        }
    }
}

/// Why a connection is refused, from the text of an error of the crate and its causes, whose kinds are private.
fn refusal_of(text: &str) -> Refusal {
    if text.contains("password missing") {
        Refusal::NoPassword
    } else if text.contains("does not support TLS") {
        Refusal::NoTls
    } else if text.contains("TLS") {
        Refusal::Certificate
    } else {
        Refusal::Other
    }
}

/// A text of the server or of the system for a message: on one line, without the dot at its end.
fn shortened(text: &str) -> String {
    let line: String = on_one_line(text.trim().trim_end_matches('.')).chars().take(LONGEST).collect();
    line
}
