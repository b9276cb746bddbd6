//! The address of the fleet's database, with the rules for passwords and encryption.

use std::io::Read;
use std::net::IpAddr;
use std::path::PathBuf;
use std::str::FromStr;
use std::time::Duration;

use tokio_postgres::Config;
use tokio_postgres::config::{Host, SslMode};

use super::error::FleetError;
use crate::config::{FleetSettings, PasswordSource};

/// How long to wait for a connection.
const CONNECT: Duration = Duration::from_secs(5);
/// How long to wait for the other computer to confirm what was sent.
const UNCONFIRMED: Duration = Duration::from_secs(10);
/// The largest password, bytes.
const LARGEST_PASSWORD: u64 = 4096;

/// Where the database of a fleet is, and how to log in.
#[derive(Clone)]
pub struct Address {
    config: Config,
    password: Option<PasswordSource>,
    certificate: Option<PathBuf>,
}

impl std::fmt::Debug for Address {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(out, "Address({self})")
    }
}

/// Hosts and database, for people.
impl std::fmt::Display for Address {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for (index, host) in self.config.get_hosts().iter().enumerate() {
            out.write_str(if index > 0 { ", " } else { "" })?;
            match host {
                Host::Tcp(name) => out.write_str(name)?,
                #[cfg(unix)]
                Host::Unix(path) => write!(out, "{}", path.display())?,
            }
        }
        if let [port] = self.config.get_ports() {
            write!(out, ":{port}")?;
        }
        match self.config.get_dbname().or(self.config.get_user()) {
            Some(database) => write!(out, "/{database}"),
            None => Ok(()),
        }
    }
}

impl Address {
    /// The address that a URL gives. Connections to other computers are encrypted and verified, unless the URL has
    /// `sslmode=disable`; those to this computer are, if it has `sslmode=require` or `verify-full`.
    ///
    /// # Errors
    /// When the text is not a URL of PostgreSQL, contains a password, or asks for encryption that may be left out.
    pub fn new(
        url: &str,
        password: Option<PasswordSource>,
        certificate: Option<PathBuf>,
    ) -> Result<Self, FleetError> {
        let wrong = |what: &str| Err(FleetError::Url(what.into()));
        if !FleetSettings::is_url(url) {
            return wrong("it does not begin with postgresql://");
        }
        if FleetSettings::has_password(url) {
            return wrong("it contains a password, which lists of processes and logs would show");
        }
        // The crate knows no `verify-full`: it never verifies, and our connector always does.
        let (place, query) = url.split_once('?').unwrap_or((url, ""));
        let mut mode = None;
        let mut rest = Vec::new();
        for pair in query.split('&').filter(|pair| !pair.is_empty()) {
            match pair.strip_prefix("sslmode=") {
                Some(given) => mode = Some(given),
                None => rest.push(pair),
            }
        }
        let url = if rest.is_empty() { place.to_owned() } else { format!("{place}?{}", rest.join("&")) };
        let mut config = Config::from_str(&url).map_err(|error| {
            let cause = std::error::Error::source(&error).map(|cause| format!(": {cause}"));
            FleetError::Url(format!("{error}{}", cause.unwrap_or_default()))
        })?;
        if config.get_hosts().is_empty() {
            return wrong("it names no host");
        }
        let is_here = config.get_hosts().iter().all(is_this_computer)
            && config.get_hostaddrs().iter().all(IpAddr::is_loopback);
        config.ssl_mode(match mode {
            Some("disable") => SslMode::Disable,
            Some("require" | "verify-full") => SslMode::Require,
            None if is_here => SslMode::Disable,
            None => SslMode::Require,
            Some(_) => {
                return wrong(
                    "`sslmode` is neither `verify-full`, `require` (which also verifies) nor `disable`",
                );
            }
        });
        config.connect_timeout(CONNECT);
        config.tcp_user_timeout(UNCONFIRMED);
        config.keepalives_idle(UNCONFIRMED);
        config.keepalives_interval(Duration::from_secs(2));
        config.keepalives_retries(3);
        if config.get_application_name().is_none() {
            config.application_name("isomark");
        }
        Ok(Self { config, password, certificate })
    }

    /// The address that a station's settings give.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn of(settings: &FleetSettings) -> Result<Self, FleetError> {
        Self::new(&settings.url, settings.password.clone(), settings.certificate.clone())
    }

    /// Whether the connection is encrypted and the server verified.
    #[must_use]
    pub fn is_encrypted(&self) -> bool {
        self.config.get_ssl_mode() == SslMode::Require
    }

    /// The file with the certificates of the authority.
    pub(super) fn certificate(&self) -> Option<&PathBuf> {
        self.certificate.as_ref()
    }

    /// The configuration with the present password: it may have been changed since the last connection.
    pub(super) fn with_password(&self) -> Result<Config, FleetError> {
        let mut config = self.config.clone();
        if let Some(source) = &self.password {
            config.password(read_password(source)?);
        }
        Ok(config)
    }
}

fn is_this_computer(host: &Host) -> bool {
    match host {
        Host::Tcp(name) => {
            name == "localhost" || name.parse::<IpAddr>().is_ok_and(|address| address.is_loopback())
        }
        #[cfg(unix)]
        Host::Unix(_) => true,
    }
}

fn read_password(source: &PasswordSource) -> Result<String, FleetError> {
    let text = match source {
        PasswordSource::File(file) => {
            let mut text = String::new();
            let read = fs_err::File::open(file)
                .and_then(|file| file.take(LARGEST_PASSWORD).read_to_string(&mut text));
            read.map_err(|error| FleetError::Password(error.to_string()))?;
            text
        }
        // The system's error may contain the password.
        PasswordSource::Variable(name) => std::env::var(name).map_err(|_| {
            FleetError::Password(format!("the environment variable {name} is not set, or is not valid UTF-8"))
        })?,
    };
    let text = text.strip_prefix('\u{feff}').unwrap_or(&text);
    match text.lines().next().unwrap_or_default() {
        "" => Err(FleetError::Password("it is empty".into())),
        password => Ok(password.to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_connections_to_this_computer_are_plain_unless_the_url_states_it() {
        for (url, is_encrypted) in [
            ("postgresql://a@localhost/x", false),
            ("postgresql://a@127.0.0.1:5433/x", false),
            ("postgresql://a@[::1]/x", false),
            ("postgresql://a@localhost/x?sslmode=verify-full", true),
            ("postgresql://a@127.0.0.1.example.com/x", true),
            ("postgresql://a@localhost.example.com/x", true),
            ("postgresql://a@localhost,db.shop.local/x", true),
            ("postgresql://a@localhost/x?hostaddr=10.0.0.7", true),
            ("postgresql://a@db.shop.local/x", true),
            ("postgresql://a@db.shop.local/x?sslmode=require&connect_timeout=3", true),
            ("postgres://a@db.shop.local/x?sslmode=disable", false),
        ] {
            assert_eq!(Address::new(url, None, None).unwrap().is_encrypted(), is_encrypted, "{url}");
        }
        for url in [
            "postgresql://a@db/x?sslmode=prefer",
            "postgresql://a@db/x?sslmode=verify-ca",
            "postgresql://a:secret@db/x",
            "postgresql://a@db/x?unknown=1",
            "postgresql:///x",
            "mysql://a@db/x",
            "",
        ] {
            let error = Address::new(url, None, None).unwrap_err().to_string();
            assert!(!error.contains("secret"), "{error}");
        }
    }
}
