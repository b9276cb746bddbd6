//! The fleet of a station: where its database is, and the station's name there.

use std::path::PathBuf;

use serde::Deserialize;
use toml::Spanned;

use super::choices::LocalSettings;
use super::error::ConfigError;
use super::page::{PasswordSource, password_source};
use super::text::SettingsText;

/// The fleet of a station.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct FleetSettings {
    /// The address of the database, without a password.
    pub url: String,
    /// Where the password is; `None` if the server asks for none.
    pub password: Option<PasswordSource>,
    /// The certificates of the authority that signed the server's; `None` for those that the system trusts.
    pub certificate: Option<PathBuf>,
    /// The station's name in the fleet.
    pub name: String,
    /// What is done with a local change of settings that the office released.
    pub local_settings: LocalSettings,
    /// The groups of stations whose jobs it takes, besides its own.
    pub lines: Vec<String>,
    /// Whether workers make the surfaces of heavy parts.
    pub workers: bool,
}

impl FleetSettings {
    /// The environment variable with the password, for commands without settings.
    pub const VARIABLE: &'static str = "ISOMARK_FLEET_PASSWORD";
    /// The greatest number of characters in a station's name.
    pub const LONGEST_NAME: usize = 100;
    /// The most lines of a station.
    const LINES: usize = 100;

    /// What a name for a station or a line must be.
    pub(crate) fn name_remedy() -> String {
        format!("Give a name on one line, with at most {} characters.", Self::LONGEST_NAME)
    }

    /// Whether a text is a name for a station or a line.
    #[must_use]
    pub fn is_name(text: &str) -> bool {
        !text.trim().is_empty()
            && !text.chars().any(char::is_control)
            && text.chars().count() <= Self::LONGEST_NAME
    }

    /// Whether a URL contains a password, which would be logged with the settings and shown in lists of processes.
    #[must_use]
    pub fn has_password(url: &str) -> bool {
        let rest = url.split_once("://").map_or(url, |(_, rest)| rest);
        let (authority, query) = rest.split_once('?').unwrap_or((rest, ""));
        let authority = authority.split('/').next().unwrap_or_default();
        authority.rsplit_once('@').is_some_and(|(user, _)| user.contains(':'))
            // A password may contain `@`, `/` and `?` by mistake.
            || rest.rsplit_once('@').is_some_and(|(user, _)| user.contains(':'))
            || query.split('&').any(|pair| pair.starts_with("password="))
    }

    /// Whether a URL begins as one of PostgreSQL does.
    #[must_use]
    pub fn is_url(url: &str) -> bool {
        url.starts_with("postgresql://") || url.starts_with("postgres://")
    }
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct FleetKeys {
    url: Option<Spanned<String>>,
    password_file: Option<Spanned<PathBuf>>,
    password_variable: Option<Spanned<String>>,
    certificate: Option<Spanned<PathBuf>>,
    name: Option<Spanned<String>>,
    local_settings: LocalSettings,
    lines: Option<Spanned<Vec<String>>>,
    workers: bool,
}

impl FleetKeys {
    /// The fleet; `None` without a URL. `station` is the name of the station; `resolved` makes a path absolute, or refuses it.
    pub(super) fn check(
        self,
        text: &SettingsText,
        station: &str,
        resolved: impl Fn(&Spanned<PathBuf>) -> Result<PathBuf, ConfigError>,
    ) -> Result<Option<FleetSettings>, ConfigError> {
        let password =
            password_source(text, "fleet", &self.password_file, &self.password_variable, &resolved)?;
        let certificate = self.certificate.as_ref().map(resolved).transpose()?;
        let wrong = |given: &Spanned<String>, what: &str, remedy: &str| ConfigError::Contradiction {
            spot: text.spot(&given.span()),
            what: what.into(),
            remedy: remedy.into(),
        };
        if let Some(name) = self.name.as_ref().filter(|name| !FleetSettings::is_name(name.get_ref())) {
            let remedy = FleetSettings::name_remedy();
            return Err(wrong(name, "`fleet.name` is not a name for the station.", &remedy));
        }
        if let Some(lines) = &self.lines
            && (lines.get_ref().len() > FleetSettings::LINES
                || !lines.get_ref().iter().all(|line| FleetSettings::is_name(line)))
        {
            return Err(ConfigError::Contradiction {
                spot: text.spot(&lines.span()),
                what: format!(
                    "`fleet.lines` has more than {} lines, or one without a name.",
                    FleetSettings::LINES
                ),
                remedy: FleetSettings::name_remedy(),
            });
        }
        let Some(url) = self.url else { return Ok(None) };
        if FleetSettings::has_password(url.get_ref()) {
            let remedy =
                "Remove the password from the URL, and give it with `password_file` or `password_variable`.";
            return Err(wrong(&url, "`fleet.url` contains a password.", remedy));
        }
        if !FleetSettings::is_url(url.get_ref()) {
            let remedy = "Give the address of a PostgreSQL database, such as \"postgresql://laser1@db.shop.local/isomark\".";
            return Err(wrong(&url, "`fleet.url` is not the address of a database.", remedy));
        }
        let name = self.name.map_or_else(|| station.to_owned(), Spanned::into_inner);
        let mut lines = self.lines.map(Spanned::into_inner).unwrap_or_default();
        lines.sort();
        lines.dedup();
        Ok(Some(FleetSettings {
            url: url.into_inner(),
            password,
            certificate,
            name,
            local_settings: self.local_settings,
            lines,
            workers: self.workers,
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_password_in_a_url_is_found() {
        for (url, has) in [
            ("postgresql://laser1@db/isomark", false),
            ("postgresql://laser1@db:5432/isomark?sslmode=disable", false),
            ("postgresql://[::1]:5432/isomark", false),
            ("postgresql:///isomark?host=/run/postgresql", false),
            ("postgresql://laser1:secret@db/isomark", true),
            ("postgresql://laser1:se@cr@db/isomark", true),
            ("postgresql://laser1:se/c?ret@db/isomark", true),
            ("postgresql://:@db/isomark", true),
            ("postgresql://db/isomark?user=a&password=secret", true),
            ("postgresql://db/isomark?password=", true),
        ] {
            assert_eq!(FleetSettings::has_password(url), has, "{url}");
        }
    }
}
