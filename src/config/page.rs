//! The page of a station in browsers: where it is, and who may open it.

use std::fmt;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};
use std::path::PathBuf;
use std::str::FromStr;

use serde::Deserialize;
use toml::Spanned;

use super::error::ConfigError;
use super::text::SettingsText;

/// The page of a station.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct PageSettings {
    /// Where the station waits for browsers; port 0 for any free port.
    pub address: SocketAddr,
    /// Where the password is; `None` if the page needs none, which only browsers on this computer can open.
    pub password: Option<PasswordSource>,
    /// Whether other computers may open it, with the password.
    pub other_computers: bool,
    /// Other names of this computer under which browsers open the page.
    pub names: Vec<Authority>,
}

impl PageSettings {
    /// The address if none is given.
    pub const ADDRESS: &'static str = "127.0.0.1:4780";

    /// Where browsers find the page, for people.
    #[must_use]
    pub fn shown_address(&self) -> String {
        let port = self.address.port();
        if !self.address.ip().is_unspecified() {
            return format!("http://{}/", self.address);
        }
        // Under a name that is not among these, the page refuses requests.
        match self.names.first() {
            Some(name) if name.port.is_some() => format!("http://{name}/"),
            Some(name) => format!("http://{name}:{port}/"),
            None => format!(
                "http://localhost:{port}/ on this computer, and at port {port} of its other addresses"
            ),
        }
    }
}

/// Where a password is. The password itself is never part of the settings, which are logged.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum PasswordSource {
    /// The first line of this file.
    File(PathBuf),
    /// The environment variable of this name.
    Variable(String),
}

/// A host and a port as in a URL: `laser1`, `192.168.0.7:4780`, `[::1]:4780`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Authority {
    /// The host.
    pub host: HostName,
    /// The port, if it is given.
    pub port: Option<u16>,
}

/// A host, parsed as a whole: `127.0.0.1.example.com` is a name, and not an address.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum HostName {
    /// An IP address.
    Address(IpAddr),
    /// A name, in lower case.
    Name(String),
}

/// A text that is not a host with or without a port.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("it is not a host name or an IP address, with or without a port")]
pub struct BadAuthority;

impl FromStr for Authority {
    type Err = BadAuthority;

    fn from_str(text: &str) -> Result<Self, BadAuthority> {
        if let Some(rest) = text.strip_prefix('[') {
            let (address, rest) = rest.split_once(']').ok_or(BadAuthority)?;
            let address: Ipv6Addr = address.parse().map_err(|_| BadAuthority)?;
            let port = match rest.strip_prefix(':') {
                Some(port) => Some(parse_port(port)?),
                None if rest.is_empty() => None,
                None => return Err(BadAuthority),
            };
            return Ok(Self { host: HostName::Address(address.into()), port });
        }
        let (host, port) = match text.split_once(':') {
            Some((host, port)) => (host, Some(parse_port(port)?)),
            None => (text, None),
        };
        let host = match host.parse::<Ipv4Addr>() {
            Ok(address) => HostName::Address(address.into()),
            Err(_) if is_name(host) => HostName::Name(host.to_ascii_lowercase()),
            Err(_) => return Err(BadAuthority),
        };
        Ok(Self { host, port })
    }
}

fn parse_port(text: &str) -> Result<u16, BadAuthority> {
    // A number in Rust may have a sign.
    let digits = text.bytes().all(|byte| byte.is_ascii_digit());
    text.parse().ok().filter(|_| digits).ok_or(BadAuthority)
}

/// Whether the text is a host name: labels of letters, digits, `-` and `_` (RFC 1123, section 2.1). Browsers read a name whose
/// last label is a number as an address, so that is none.
fn is_name(text: &str) -> bool {
    let is_label = |label: &str| {
        let inner = |byte: u8| byte.is_ascii_alphanumeric() || byte == b'-' || byte == b'_';
        !label.is_empty()
            && label.len() <= 63
            && label.bytes().all(inner)
            && !label.starts_with('-')
            && !label.ends_with('-')
    };
    let last = text.rsplit('.').next().unwrap_or_default();
    let is_number = last.starts_with("0x") || last.bytes().all(|byte| byte.is_ascii_digit());
    text.len() <= 253 && text.split('.').all(is_label) && !is_number
}

impl fmt::Display for Authority {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.host {
            HostName::Address(IpAddr::V6(address)) => write!(out, "[{address}]")?,
            HostName::Address(address) => write!(out, "{address}")?,
            HostName::Name(name) => out.write_str(name)?,
        }
        self.port.map_or(Ok(()), |port| write!(out, ":{port}"))
    }
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct PageKeys {
    address: Option<Spanned<String>>,
    password_file: Option<Spanned<PathBuf>>,
    password_variable: Option<Spanned<String>>,
    other_computers: bool,
    names: Option<Spanned<Vec<String>>>,
}

impl PageKeys {
    /// The page; `None` without an address. `resolved` makes a path absolute, or refuses it.
    pub(super) fn check(
        self,
        text: &SettingsText,
        resolved: impl Fn(&Spanned<PathBuf>) -> Result<PathBuf, ConfigError>,
    ) -> Result<Option<PageSettings>, ConfigError> {
        let wrong = |span: std::ops::Range<usize>, what: String, remedy: &str| ConfigError::Contradiction {
            spot: text.spot(&span),
            what,
            remedy: remedy.into(),
        };
        let password = password_source(text, "page", &self.password_file, &self.password_variable, resolved)?;
        let is_open = self.other_computers && password.is_some();
        let remedy = "Open the page on this computer only (127.0.0.1), or set `other_computers = true` and a password \
                      (`password_file` or `password_variable`) under [page].";
        let mut names = Vec::new();
        if let Some(given) = &self.names {
            for name in given.get_ref() {
                let remedy = "Give names or addresses of this computer, such as \"laser1.shop.local\" or \"192.168.0.7:8080\".";
                let parsed = name.parse().map_err(|error| {
                    wrong(given.span(), format!("`{name}` in `page.names`: {error}."), remedy)
                });
                names.push(parsed?);
            }
            if !names.is_empty() && !is_open {
                let what = "`page.names` lets other computers open the page.".to_owned();
                return Err(wrong(given.span(), what, remedy));
            }
        }
        let Some(address) = &self.address else { return Ok(None) };
        let Some(socket) = socket_address(address.get_ref()) else {
            let what = format!("`{}` is not an address for the page.", address.get_ref());
            let remedy = format!(
                "Give an IP address of this computer and a port, such as \"{}\".",
                PageSettings::ADDRESS
            );
            return Err(wrong(address.span(), what, &remedy));
        };
        if !socket.ip().is_loopback() && !is_open {
            let what = format!("At {socket} other computers could open the page.");
            return Err(wrong(address.span(), what, remedy));
        }
        Ok(Some(PageSettings { address: socket, password, other_computers: self.other_computers, names }))
    }
}

/// Where the password is that `<table>.password_file` or `<table>.password_variable` gives; `resolved` makes a path absolute,
/// or refuses it.
pub(super) fn password_source(
    text: &SettingsText,
    table: &str,
    file: &Option<Spanned<PathBuf>>,
    variable: &Option<Spanned<String>>,
    resolved: impl Fn(&Spanned<PathBuf>) -> Result<PathBuf, ConfigError>,
) -> Result<Option<PasswordSource>, ConfigError> {
    let wrong = |what: String, remedy: String| {
        let span = variable.as_ref().map_or(0..0, Spanned::span);
        ConfigError::Contradiction { spot: text.spot(&span), what, remedy }
    };
    Ok(match (file, variable) {
        (Some(_), Some(_)) => {
            let what =
                format!("`{table}.password_file` and `{table}.password_variable` both give the password.");
            return Err(wrong(what, "Remove one of them.".into()));
        }
        (Some(file), None) => Some(PasswordSource::File(resolved(file)?)),
        (None, Some(variable)) => {
            let name = variable.get_ref();
            if name.is_empty() || name.contains(['=', '\0']) {
                let what = format!("`{table}.password_variable` is not the name of an environment variable.");
                let example = format!("ISOMARK_{}_PASSWORD", table.to_uppercase());
                let remedy =
                    format!("Give the name of the variable that holds the password, such as {example}.");
                return Err(wrong(what, remedy));
            }
            Some(PasswordSource::Variable(name.clone()))
        }
        (None, None) => None,
    })
}

/// An IP address with a port; `localhost` for 127.0.0.1.
fn socket_address(text: &str) -> Option<SocketAddr> {
    let Authority { host, port: Some(port) } = text.parse().ok()? else { return None };
    match host {
        HostName::Address(address) => Some(SocketAddr::new(address, port)),
        HostName::Name(name) => {
            (name == "localhost").then(|| SocketAddr::new(Ipv4Addr::LOCALHOST.into(), port))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hosts_are_parsed_as_a_whole() {
        let parsed = |text: &str| text.parse::<Authority>().map(|authority| (authority.host, authority.port));
        let name = |name: &str| HostName::Name(name.into());
        let address = |text: &str| HostName::Address(text.parse().unwrap());
        for (text, host, port) in [
            ("localhost", name("localhost"), None),
            ("LocalHost:4780", name("localhost"), Some(4780)),
            ("127.0.0.1:4780", address("127.0.0.1"), Some(4780)),
            ("[::1]:4780", address("::1"), Some(4780)),
            ("[::1]", address("::1"), None),
            ("127.0.0.1.evil.com:4780", name("127.0.0.1.evil.com"), Some(4780)),
            ("localhost.evil", name("localhost.evil"), None),
            ("laser_1-a.shop.local", name("laser_1-a.shop.local"), None),
        ] {
            assert_eq!(parsed(text), Ok((host, port)), "{text}");
        }
        let long = format!("{}.example", "a".repeat(64));
        for text in [
            "",
            ":",
            ":4780",
            "localhost:",
            "localhost:+80",
            "localhost:65536",
            "localhost:4780:1",
            "::1",
            "[::1",
            "[::1]4780",
            "[127.0.0.1]",
            "[fe80::1%eth0]",
            "localhost.",
            ".localhost",
            "a..b",
            "-a",
            "a-",
            "a b",
            "user@localhost",
            "127.1",
            "0x7f.1",
            "2130706433",
            "127.0.0.01x/",
            "localhost/",
            "localh\u{f6}st",
            &long,
        ] {
            assert_eq!(parsed(text), Err(BadAuthority), "{text}");
        }
    }

    #[test]
    fn a_host_is_shown_as_in_a_url() {
        for text in ["localhost", "127.0.0.1:4780", "[::1]:4780", "[::1]"] {
            assert_eq!(text.parse::<Authority>().unwrap().to_string(), text);
        }
    }
}
