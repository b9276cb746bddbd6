//! How a station receives the releases of its fleet: a few at a time, between its other work.

use std::collections::{BTreeMap, BTreeSet};
use std::io;

use tokio::time::{Duration, Instant};

use super::error::FleetError;
use super::releases::{self, Listed};
use super::session::Session;
use super::sku_files::{Report, SkuFiles};
use crate::config::Sku;

/// Releases that are fetched at a time.
const AT_A_TIME: usize = 20;
/// SKUs that wait to be fetched; of more, the whole list is read again.
const MOST: usize = 5_000;
/// The longest key of a SKU, bytes.
const LONGEST_KEY: usize = 600;
/// The pause after a file could not be written.
const PAUSE: Duration = Duration::from_secs(10);

/// The releases that a station has yet to receive in one connection.
#[derive(Debug)]
pub(super) struct Incoming {
    /// The last SKU of the list that was read; `None` when all of it was read.
    list: Option<String>,
    wanted: BTreeSet<String>,
    /// The list is read again then, because a file could not be written.
    again: Option<Instant>,
}

impl Incoming {
    /// A new connection: what was released since the last one is in the list.
    pub(super) fn new() -> Self {
        Self { list: Some(String::new()), wanted: BTreeSet::new(), again: None }
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
        !self.wanted.is_empty()
            || self.list.is_some()
            || self.again.is_some_and(|again| again <= Instant::now())
    }

    /// Does a little of the work. Returns the SKUs whose files may have changed.
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
        let mut reports = BTreeMap::new();
        let mut changed = Vec::new();
        if !self.wanted.is_empty() {
            changed = self.fetch(session, station, files, &mut reports).await?;
        } else if let Some(after) = self.list.take() {
            self.list = self.read_list(session, station, files, &after, &mut reports).await?;
        }
        send(session, station, reports).await?;
        Ok(changed)
    }

    async fn fetch(
        &mut self,
        session: &Session,
        station: &str,
        files: &SkuFiles,
        reports: &mut BTreeMap<String, Report>,
    ) -> Result<Vec<Sku>, FleetError> {
        let some: Vec<String> = self.wanted.iter().take(AT_A_TIME).cloned().collect();
        let received = releases::fetch(session, station, &some).await?;
        self.wanted.retain(|sku| !some.contains(sku));
        let listed = files.listed();
        let mut changed = Vec::new();
        for received in received {
            let release = match received {
                Ok(release) => release,
                Err((sku, version, why)) => {
                    reports.insert(sku.clone(), files.refuse(&sku, version, why));
                    continue;
                }
            };
            let taken = match &listed {
                Ok(listed) => files.take(&release, listed.get(&release.sku).map(|file| &**file)),
                Err(error) => Err(io::Error::other(error.to_string())),
            };
            match taken {
                Ok(report) => {
                    reports.insert(release.sku.key().to_owned(), report);
                    changed.push(release.sku);
                }
                Err(error) => self.is_stuck(&error),
            }
        }
        Ok(changed)
    }

    /// Reads a page of the list. Returns its last SKU, or `None` at its end.
    async fn read_list(
        &mut self,
        session: &Session,
        station: &str,
        files: &SkuFiles,
        after: &str,
        reports: &mut BTreeMap<String, Report>,
    ) -> Result<Option<String>, FleetError> {
        let page = releases::page(session, station, after).await?;
        let Some(last) = page.last().map(|row| row.sku.clone()) else { return Ok(None) };
        let listed = match files.listed() {
            Ok(listed) => listed,
            Err(error) => {
                self.is_stuck(&error);
                return Ok(None);
            }
        };
        for Listed { sku: key, version, blake3, reported } in page {
            let sku = key.parse::<Sku>().ok().filter(|sku| sku.key() == key);
            let compared = match &sku {
                Some(sku) => {
                    let file = listed.get(sku).map(|file| &**file);
                    files.compared(sku, version, blake3.as_deref(), file)
                }
                // The row itself states what is wrong.
                None => Ok(None),
            };
            match compared {
                Ok(Some(report)) => {
                    if reported.as_ref().map(|(version, state)| (*version, &**state))
                        != Some((report.version, report.state.name()))
                    {
                        reports.insert(key, report);
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
