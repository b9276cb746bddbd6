//! How a station receives the releases of its fleet: a few at a time, between its other work.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::io;
use std::path::{Path, PathBuf};

use tokio::time::{Duration, Instant};

use super::error::FleetError;
use super::releases::{self, Listed, Received};
use super::session::Session;
use super::sku_files::{Report, SkuFiles};
use crate::config::Sku;

/// Releases that are fetched at a time.
const AT_A_TIME: usize = 20;
/// SKUs that wait to be fetched; of more, the whole list is read again.
const MOST: usize = 5_000;
/// The longest key of a SKU, bytes.
const LONGEST_KEY: usize = 600;
/// How long a list of the files is used.
const LISTED: Duration = Duration::from_secs(2);
/// The time between two messages to the station while files are being written.
const TELL: Duration = Duration::from_secs(1);
/// The pause after a file could not be written.
const PAUSE: Duration = Duration::from_secs(10);

/// The releases that a station has yet to receive in one connection.
#[derive(Debug)]
pub(super) struct Incoming {
    /// The last SKU of the list that was read; `None` when all of it was read.
    list: Option<String>,
    wanted: BTreeSet<String>,
    /// Releases that were fetched and are not written yet.
    received: VecDeque<Received>,
    /// SKUs whose files may have changed, and when the station was informed last.
    changed: Vec<Sku>,
    told: Instant,
    /// What the fleet is to know.
    reports: BTreeMap<String, Report>,
    /// The list is read again then, because a file could not be written.
    again: Option<Instant>,
    /// The file of each SKU, and when they were listed.
    files: Option<(Instant, BTreeMap<Sku, PathBuf>)>,
}

impl Incoming {
    /// A new connection: what was released since the last one is in the list.
    pub(super) fn new() -> Self {
        Self {
            list: Some(String::new()),
            wanted: BTreeSet::new(),
            received: VecDeque::new(),
            changed: Vec::new(),
            told: Instant::now(),
            reports: BTreeMap::new(),
            again: None,
            files: None,
        }
    }

    /// Something was released for this SKU. The text may come from any login.
    pub(super) fn ask(&mut self, sku: &str) {
        if self.wanted.len() >= MOST {
            self.wanted.clear();
            self.list = Some(String::new());
        } else if sku.len() <= LONGEST_KEY {
            self.wanted.insert(sku.to_owned());
        }
    }

    /// Reads the whole list again.
    pub(super) fn ask_for_all(&mut self) {
        self.list = Some(String::new());
    }

    /// Whether there is something to do now.
    pub(super) fn has_work(&self) -> bool {
        !self.received.is_empty()
            || !self.wanted.is_empty()
            || self.list.is_some()
            || self.again.is_some_and(|again| again <= Instant::now())
    }

    /// Does a little of the work: at most one file is written. Returns SKUs whose files may have changed, not more often than once in
    /// a second: the station then looks at all its files.
    pub(super) async fn step(
        &mut self,
        session: &Session,
        station: &str,
        files: &SkuFiles,
    ) -> Result<Vec<Sku>, FleetError> {
        if self.again.is_some_and(|again| again <= Instant::now()) {
            self.again = None;
            self.ask_for_all();
        }
        if let Some(received) = self.received.pop_front() {
            let changed = self.take(received, files);
            self.changed.extend(changed);
        } else if !self.wanted.is_empty() {
            let some: Vec<String> = self.wanted.iter().take(AT_A_TIME).cloned().collect();
            self.received.extend(releases::fetch(session, station, &some).await?);
            self.wanted.retain(|sku| !some.contains(sku));
        } else if let Some(after) = self.list.take() {
            self.list = self.read_list(session, station, files, &after).await?;
        }
        if self.received.is_empty() {
            send(session, station, std::mem::take(&mut self.reports)).await?;
        }
        if self.has_work() && self.told.elapsed() < TELL {
            return Ok(Vec::new());
        }
        self.told = Instant::now();
        Ok(std::mem::take(&mut self.changed))
    }

    fn take(&mut self, received: Received, files: &SkuFiles) -> Option<Sku> {
        let release = match received {
            Ok(release) => release,
            Err((sku, version, why)) => {
                let report = files.refuse(&sku, version, why);
                self.reports.insert(sku, report);
                return None;
            }
        };
        match self.listed(files).and_then(|()| files.take(&release, self.file(&release.sku))) {
            Ok(report) => {
                self.reports.insert(release.sku.key().to_owned(), report);
                Some(release.sku)
            }
            Err(error) => {
                self.is_stuck(&error);
                None
            }
        }
    }

    /// Reads a page of the list. Returns its last SKU, or `None` at its end.
    async fn read_list(
        &mut self,
        session: &Session,
        station: &str,
        files: &SkuFiles,
        after: &str,
    ) -> Result<Option<String>, FleetError> {
        let page = releases::page(session, station, after).await?;
        let Some(last) = page.last().map(|row| row.sku.clone()) else { return Ok(None) };
        if let Err(error) = self.listed(files) {
            self.is_stuck(&error);
            return Ok(None);
        }
        for Listed { sku: key, version, blake3, reported } in page {
            let sku = key.parse::<Sku>().ok().filter(|sku| sku.key() == key);
            let compared = match &sku {
                Some(sku) => files.compared(sku, version, blake3.as_deref(), self.file(sku)),
                // The row itself states what is wrong.
                None => Ok(None),
            };
            match compared {
                Ok(Some(report)) => {
                    if reported.as_ref().map(|(version, state)| (*version, &**state))
                        != Some((report.version, report.state.name()))
                    {
                        self.reports.insert(key, report);
                    }
                }
                Ok(None) => {
                    self.wanted.insert(key);
                }
                Err(error) => self.is_stuck(&error),
            }
        }
        Ok(Some(last).filter(|last| &**last > after))
    }

    /// Lists the files, unless they were listed a moment ago: one that was made since is found under its usual name.
    fn listed(&mut self, files: &SkuFiles) -> io::Result<()> {
        if self.files.as_ref().is_none_or(|(at, _)| at.elapsed() >= LISTED) {
            self.files = None;
            self.files = Some((Instant::now(), files.listed()?));
        }
        Ok(())
    }

    fn file(&self, sku: &Sku) -> Option<&Path> {
        self.files.as_ref().and_then(|(_, files)| files.get(sku)).map(|file| &**file)
    }

    fn is_stuck(&mut self, error: &io::Error) {
        tracing::debug!("released settings wait: {error}");
        self.again = Some(Instant::now() + PAUSE);
    }
}

/// Notes in the fleet what the station does with releases.
pub(super) async fn send(
    session: &Session,
    station: &str,
    reports: BTreeMap<String, Report>,
) -> Result<(), FleetError> {
    if reports.is_empty() {
        return Ok(());
    }
    match releases::report(session, station, &reports).await {
        // It fails each time, and the next connection compares again.
        Err(error) if error.is_final() => {
            tracing::error!("the fleet does not accept a report about settings: {error}");
            Ok(())
        }
        sent => sent,
    }
}
