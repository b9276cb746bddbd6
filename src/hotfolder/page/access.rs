//! Who may ask the page for what.
//!
//! | threat | check |
//! |---|---|
//! | a web site whose name resolves to this computer (DNS rebinding) | the `Host` of every request is parsed and must be this computer's |
//! | a web site that sends requests to this computer (CSRF) | a POST has the token of the page, and the `Origin` of the page |
//! | a person at another computer | the port is open there only with a password |
//! | guessing of that password | wrong passwords block their sender for a growing time |

use std::collections::BTreeMap;
use std::net::{IpAddr, Ipv6Addr, SocketAddr};
use std::time::{Duration, Instant};

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use hyper::HeaderMap;
use hyper::header::{AUTHORIZATION, HOST, HeaderName, ORIGIN};

use crate::config::{Authority, HostName, PasswordSource};
use crate::reason::Reason;

/// The fewest characters of a password.
const SHORTEST_PASSWORD: usize = 8;
/// The longest content of a password file that is read, bytes.
const LARGEST_PASSWORD: u64 = 4096;
/// Wrong passwords of one sender that have no consequence: people mistype.
const FREE_MISTAKES: u32 = 5;
/// The longest time for which a sender is blocked.
const LONGEST_BLOCK: Duration = Duration::from_secs(60);
/// How long a wrong password is remembered.
const MEMORY: Duration = Duration::from_secs(600);
/// The number of senders whose wrong passwords are remembered.
const MAX_SENDERS: usize = 1024;

type Key = [u8; 32];

/// The keys and the password of the page, which are secret.
pub(super) struct Secrets {
    /// For names that the page makes.
    key: Key,
    /// In the forms of the page.
    token: String,
    /// The password, as a hash with the key.
    password: Option<Key>,
}

impl Secrets {
    /// New secrets, and the password from its source.
    pub(super) fn new(source: Option<&PasswordSource>) -> Result<Self, Reason> {
        let (mut key, mut token) = (Key::default(), Key::default());
        for secret in [&mut key, &mut token] {
            getrandom::fill(secret).map_err(|error| {
                let what = format!("The system gives no random numbers for the page: {error}.");
                Reason::new("page-password", what, "Restart the computer, and report this if it remains.")
            })?;
        }
        let password = source.map(read_password).transpose()?;
        let password = password.map(|password| hmac_sha256::HMAC::mac(password.as_bytes(), key));
        Ok(Self { key, token: hexadecimal(&token[..16]), password })
    }

    /// A name that cannot be guessed, always the same for the same words.
    pub(super) fn name(&self, words: &[&str]) -> String {
        let mut text = Vec::new();
        for word in words {
            text.extend((word.len() as u64).to_le_bytes());
            text.extend(word.as_bytes());
        }
        hexadecimal(&hmac_sha256::HMAC::mac(text, self.key)[..16])
    }

    /// The token that belongs into every form.
    pub(super) fn token(&self) -> &str {
        &self.token
    }

    pub(super) fn is_token(&self, given: &str) -> bool {
        self.are_equal(self.token.as_bytes(), given.as_bytes())
    }

    fn is_password(&self, given: &[u8]) -> bool {
        let given = hmac_sha256::HMAC::mac(given, self.key);
        self.password.is_some_and(|password| self.are_equal(&password, &given))
    }

    /// Compares in a time that does not depend on where two texts differ: it is that of their hashes with the key.
    fn are_equal(&self, one: &[u8], other: &[u8]) -> bool {
        let [one, other] = [one, other].map(|text| hmac_sha256::HMAC::mac(text, self.key));
        one.iter().zip(other).fold(0, |all, (a, b)| all | (a ^ b)) == 0
    }
}

fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// The password; no message ever contains it.
fn read_password(source: &PasswordSource) -> Result<String, Reason> {
    let (place, text) = match source {
        PasswordSource::File(file) => {
            let place = format!("The password file {} of the page", file.display());
            (place, read_start(file))
        }
        PasswordSource::Variable(name) => {
            let place = format!("The environment variable {name} with the password of the page");
            // The system's error may contain the password.
            let error = |_| std::io::Error::other("it is not set, or is not valid UTF-8");
            (place, std::env::var(name).map_err(error))
        }
    };
    let remedy =
        format!("Write a password of at least {SHORTEST_PASSWORD} characters there. isomark tries again.");
    let wrong = |how: String| Reason::new("page-password", format!("{place} {how}."), remedy);
    let text = match text {
        Ok(text) => text,
        Err(error) => return Err(wrong(format!("cannot be read: {error}"))),
    };
    let password = text.lines().next().unwrap_or_default();
    match password.chars().count() {
        0 => Err(wrong("is empty".into())),
        count if count < SHORTEST_PASSWORD => Err(wrong("is too short".into())),
        _ => Ok(password.to_owned()),
    }
}

/// Why browsers could not enter the password; a variable that is not set here may be set for the station.
#[cfg(feature = "cli")]
pub(crate) fn password_trouble(source: &PasswordSource) -> Option<Reason> {
    match source {
        PasswordSource::Variable(name) if std::env::var_os(name).is_none() => None,
        source => read_password(source).err(),
    }
}

fn read_start(file: &std::path::Path) -> std::io::Result<String> {
    use std::io::Read;
    let mut text = String::new();
    std::fs::File::open(file)?.take(LARGEST_PASSWORD).read_to_string(&mut text)?;
    Ok(text)
}

/// Why a request is not answered.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Refusal {
    /// It has no host, several, or one that is none.
    NoHost,
    /// It was sent to another host.
    OtherHost,
    /// It comes from a page of another host.
    OtherOrigin,
    /// It needs the password.
    NoPassword,
    /// Its sender gave too many wrong passwords, and must wait.
    Blocked(Duration),
}

/// The rules of one page.
pub(super) struct Access {
    address: SocketAddr,
    names: Vec<Authority>,
    secrets: Secrets,
    throttle: Throttle,
}

impl Access {
    pub(super) fn new(address: SocketAddr, names: Vec<Authority>, secrets: Secrets) -> Self {
        Self { address, names, secrets, throttle: Throttle::default() }
    }

    pub(super) fn secrets(&self) -> &Secrets {
        &self.secrets
    }

    /// The address for people, for the log.
    pub(super) fn shown_address(&self) -> String {
        match self.address.ip().is_unspecified() {
            true => format!(
                "http://localhost:{0}/ on this computer, and at port {0} of its other addresses",
                self.address.port()
            ),
            false => format!("http://{}/", self.address),
        }
    }

    /// The host of a request that reached this computer at `local`.
    pub(super) fn host(&self, headers: &HeaderMap, local: SocketAddr) -> Result<Authority, Refusal> {
        let host: Authority =
            single(headers, HOST).and_then(|host| host.parse().ok()).ok_or(Refusal::NoHost)?;
        let (ip, port) = (local.ip().to_canonical(), local.port());
        let is_its_port = host.port.unwrap_or(80) == port;
        let is_own = is_its_port
            && match &host.host {
                HostName::Address(address) => *address == ip,
                HostName::Name(name) => name == "localhost" && ip.is_loopback(),
            };
        let is_named = |name: &Authority| {
            name.host == host.host
                && match name.port {
                    Some(_) => name.port == host.port,
                    // Without a port behind a proxy, which has its own.
                    None => host.port.is_none() || is_its_port,
                }
        };
        if is_own || self.names.iter().any(is_named) { Ok(host) } else { Err(Refusal::OtherHost) }
    }

    /// Whether a request that changes something was sent by this page.
    pub(super) fn origin(&self, headers: &HeaderMap, host: &Authority) -> Result<(), Refusal> {
        let is_own = |origin: &str| {
            let authority = origin.strip_prefix("http://").or_else(|| origin.strip_prefix("https://"));
            authority.and_then(|authority| authority.parse::<Authority>().ok()).as_ref() == Some(host)
        };
        let site = HeaderName::from_static("sec-fetch-site");
        // Programs other than browsers send neither; they need the token, too.
        let is_right = |name: HeaderName, check: &dyn Fn(&str) -> bool| {
            !headers.contains_key(&name) || single(headers, name).is_some_and(check)
        };
        let is_same = is_right(ORIGIN, &is_own) && is_right(site, &|site| site == "same-origin");
        if is_same { Ok(()) } else { Err(Refusal::OtherOrigin) }
    }

    /// Whether the sender may see the page.
    pub(super) fn entry(&mut self, headers: &HeaderMap, sender: IpAddr, now: Instant) -> Result<(), Refusal> {
        if self.secrets.password.is_none() {
            return Ok(());
        }
        let given = single(headers, AUTHORIZATION).and_then(password_in).ok_or(Refusal::NoPassword)?;
        if let Some(wait) = self.throttle.wait(sender, now) {
            return Err(Refusal::Blocked(wait));
        }
        if self.secrets.is_password(&given) {
            self.throttle.forget(sender);
            return Ok(());
        }
        self.throttle.mistake(sender, now);
        Err(Refusal::NoPassword)
    }
}

/// The value of a header that is there exactly once.
fn single(headers: &HeaderMap, name: HeaderName) -> Option<&str> {
    let mut values = headers.get_all(name).iter();
    let value = values.next()?;
    value.to_str().ok().filter(|_| values.next().is_none())
}

/// The password of the scheme Basic (RFC 7617); the user's name has no meaning.
fn password_in(header: &str) -> Option<Vec<u8>> {
    let (scheme, credentials) = header.split_once(' ')?;
    let decoded =
        STANDARD.decode(credentials.trim()).ok().filter(|_| scheme.eq_ignore_ascii_case("basic"))?;
    let colon = decoded.iter().position(|byte| *byte == b':')?;
    Some(decoded[colon + 1..].to_vec())
}

/// The wrong passwords of each sender.
#[derive(Default)]
struct Throttle {
    senders: BTreeMap<IpAddr, Mistakes>,
}

struct Mistakes {
    count: u32,
    last: Instant,
}

impl Mistakes {
    /// How long the sender is blocked after its last mistake: 1, 2, 4 … s.
    fn block(&self) -> Duration {
        let doubled = self.count.checked_sub(FREE_MISTAKES).map(|more| 1_u64 << more.min(6));
        doubled.map_or(Duration::ZERO, Duration::from_secs).min(LONGEST_BLOCK)
    }
}

impl Throttle {
    /// How long the sender must wait; `None` if it may try now.
    fn wait(&self, sender: IpAddr, now: Instant) -> Option<Duration> {
        let mistakes = self.senders.get(&network_of(sender))?;
        let left = mistakes.block().saturating_sub(now.saturating_duration_since(mistakes.last));
        (left > Duration::ZERO).then_some(left)
    }

    fn mistake(&mut self, sender: IpAddr, now: Instant) {
        let sender = network_of(sender);
        self.senders.retain(|_, mistakes| now.saturating_duration_since(mistakes.last) < MEMORY);
        if self.senders.len() >= MAX_SENDERS && !self.senders.contains_key(&sender) {
            let oldest = self.senders.iter().min_by_key(|(_, mistakes)| mistakes.last);
            if let Some(oldest) = oldest.map(|(sender, _)| *sender) {
                self.senders.remove(&oldest);
            }
        }
        let mistakes = self.senders.entry(sender).or_insert(Mistakes { count: 0, last: now });
        mistakes.count = mistakes.count.saturating_add(1);
        mistakes.last = now;
        if mistakes.count == FREE_MISTAKES {
            tracing::warn!(
                "{sender} gave {FREE_MISTAKES} wrong passwords for the page; it must wait before each further one"
            );
        }
    }

    fn forget(&mut self, sender: IpAddr) {
        self.senders.remove(&network_of(sender));
    }
}

/// The address, or the network of 64 bits that one customer of IPv6 has.
fn network_of(address: IpAddr) -> IpAddr {
    match address.to_canonical() {
        IpAddr::V6(address) => Ipv6Addr::from_bits(address.to_bits() & !u128::from(u64::MAX)).into(),
        address => address,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn access(names: &[&str], password: Option<&str>) -> Access {
        let mut secrets = Secrets::new(None).unwrap();
        secrets.password = password.map(|password| hmac_sha256::HMAC::mac(password, secrets.key));
        let names = names.iter().map(|name| name.parse().unwrap()).collect();
        Access::new("127.0.0.1:4780".parse().unwrap(), names, secrets)
    }

    fn headers(all: &[(&'static str, &str)]) -> HeaderMap {
        let mut headers = HeaderMap::new();
        for (name, value) in all {
            headers.append(*name, value.parse().unwrap());
        }
        headers
    }

    #[test]
    fn only_names_of_this_computer_are_its_hosts() {
        let host = |access: &Access, local: &str, hosts: &[&str]| {
            let all: Vec<_> = hosts.iter().map(|host| ("host", *host)).collect();
            access.host(&headers(&all), local.parse().unwrap()).map(|host| host.to_string())
        };
        let local = access(&[], None);
        for own in ["127.0.0.1:4780", "localhost:4780", "LOCALHOST:4780"] {
            assert!(host(&local, "127.0.0.1:4780", &[own]).is_ok(), "{own}");
        }
        assert!(host(&local, "[::1]:4780", &["[::1]:4780"]).is_ok());
        assert!(host(&local, "[::ffff:10.0.0.7]:80", &["10.0.0.7"]).is_ok());
        for other in [
            "127.0.0.1",
            "127.0.0.1:80",
            "127.0.0.1:4781",
            "127.0.0.2:4780",
            "[::1]:4780",
            "127.0.0.1.evil.com:4780",
            "localhost.evil:4780",
            "evil.com",
            "evil.com:4780",
            "localhost",
            "0.0.0.0:4780",
            "10.0.0.7:4780",
        ] {
            assert_eq!(host(&local, "127.0.0.1:4780", &[other]), Err(Refusal::OtherHost), "{other}");
        }
        assert_eq!(host(&local, "10.0.0.7:4780", &["localhost:4780"]), Err(Refusal::OtherHost));
        let broken: [&[&str]; 6] = [
            &[],
            &[""],
            &["127.0.0.1:4780", "127.0.0.1:4780"],
            &["localhost:4780@evil.com"],
            &["localhost:4780, evil.com"],
            &["[::1"],
        ];
        for hosts in broken {
            assert_eq!(host(&local, "127.0.0.1:4780", hosts), Err(Refusal::NoHost), "{hosts:?}");
        }
        let named = access(&["laser1.shop.local", "proxy.local:8443"], None);
        for own in ["laser1.shop.local", "Laser1.shop.local:4780", "proxy.local:8443"] {
            assert!(host(&named, "10.0.0.7:4780", &[own]).is_ok(), "{own}");
        }
        for other in ["laser1.shop.local:81", "proxy.local", "proxy.local:4780", "x.laser1.shop.local:4780"] {
            assert_eq!(host(&named, "10.0.0.7:4780", &[other]), Err(Refusal::OtherHost), "{other}");
        }
    }

    #[test]
    fn only_the_page_itself_is_its_origin() {
        let access = access(&[], None);
        let host = "127.0.0.1:4780".parse().unwrap();
        let origin = |all: &[(&'static str, &str)]| access.origin(&headers(all), &host).is_ok();
        let own = ("origin", "http://127.0.0.1:4780");
        assert!(origin(&[]) && origin(&[own]) && origin(&[own, ("sec-fetch-site", "same-origin")]));
        for other in [
            "null",
            "",
            "http://127.0.0.1",
            "http://127.0.0.1:4781",
            "http://localhost:4780",
            "http://127.0.0.1:4780.evil.com",
            "http://evil.com",
            "file://127.0.0.1:4780",
            "http://127.0.0.1:4780/",
        ] {
            assert!(!origin(&[("origin", other)]), "{other}");
        }
        assert!(!origin(&[own, own]));
        for site in ["cross-site", "same-site", "none", ""] {
            assert!(
                !origin(&[own, ("sec-fetch-site", site)]) && !origin(&[("sec-fetch-site", site)]),
                "{site}"
            );
        }
    }

    #[test]
    fn wrong_passwords_block_their_sender_for_a_growing_time() {
        let mut access = access(&[], Some("correct horse"));
        let (start, [sender, other]) =
            (Instant::now(), ["10.0.0.7", "10.0.0.8"].map(|ip| ip.parse().unwrap()));
        let mut enter = |password: &str, sender: IpAddr, after: u64| {
            let credentials = format!("Basic {}", STANDARD.encode(format!("anybody:{password}")));
            access.entry(
                &headers(&[("authorization", &credentials)]),
                sender,
                start + Duration::from_secs(after),
            )
        };
        assert_eq!(enter("correct horse", sender, 0), Ok(()));
        for _ in 0..FREE_MISTAKES {
            assert_eq!(enter("wrong", sender, 0), Err(Refusal::NoPassword));
        }
        assert_eq!(enter("correct horse", sender, 0), Err(Refusal::Blocked(Duration::from_secs(1))));
        assert_eq!(enter("correct horse", other, 0), Ok(()));
        assert_eq!(enter("wrong", sender, 1), Err(Refusal::NoPassword));
        assert_eq!(enter("correct horse", sender, 1), Err(Refusal::Blocked(Duration::from_secs(2))));
        assert_eq!(enter("correct horse", sender, 3), Ok(()));
        assert_eq!(enter("wrong", sender, 3), Err(Refusal::NoPassword));
        for header in [
            "",
            "Basic",
            "Basic !",
            "Basic YQ==",
            "Bearer YTpjb3JyZWN0IGhvcnNl",
            "Basic YTpjb3JyZWN0IGhvcnNlIA==",
        ] {
            let entry = access.entry(&headers(&[("authorization", header)]), other, start);
            assert_eq!(entry, Err(Refusal::NoPassword), "{header}");
        }
        assert_eq!(access.entry(&HeaderMap::new(), sender, start), Err(Refusal::NoPassword));
    }

    #[test]
    fn the_memory_of_wrong_passwords_is_bounded() {
        let (mut throttle, now) = (Throttle::default(), Instant::now());
        for index in 0..3 * MAX_SENDERS as u32 {
            throttle.mistake(std::net::Ipv4Addr::from_bits(index).into(), now);
        }
        assert_eq!(throttle.senders.len(), MAX_SENDERS);
        // One network of IPv6 is one sender.
        let [one, other]: [IpAddr; 2] = ["2001:db8::1", "2001:db8::ffff"].map(|ip| ip.parse().unwrap());
        for _ in 0..FREE_MISTAKES {
            throttle.mistake(one, now);
        }
        assert!(throttle.wait(other, now).is_some());
        throttle.mistake(other, now + MEMORY);
        assert_eq!(throttle.senders.len(), 1);
    }

    #[test]
    fn a_password_has_eight_characters_on_the_first_line() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("password.txt");
        let source = PasswordSource::File(file.clone());
        assert!(read_password(&source).unwrap_err().what.contains("cannot be read"));
        for (text, expected) in [
            ("correct horse\r\nanother line\n", Ok("correct horse")),
            (
                "\u{e4}\u{e4}\u{e4}\u{e4}\u{e4}\u{e4}\u{e4}\u{e4}",
                Ok("\u{e4}\u{e4}\u{e4}\u{e4}\u{e4}\u{e4}\u{e4}\u{e4}"),
            ),
            ("short12", Err("is too short")),
            ("\ncorrect horse", Err("is empty")),
        ] {
            std::fs::write(&file, text).unwrap();
            match (read_password(&source), expected) {
                (Ok(password), Ok(expected)) => assert_eq!(password, expected),
                (Err(reason), Err(expected)) => {
                    assert!(
                        reason.what.contains(expected) && !reason.to_string().contains("short12"),
                        "{reason}"
                    );
                }
                (read, expected) => panic!("{read:?} is not {expected:?}"),
            }
        }
    }
}
