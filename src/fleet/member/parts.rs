//! Current parts: what this station learned goes to the fleet, and what others learned comes here.

use std::collections::VecDeque;

use super::Member;
use crate::cache::{Cache, CurrentPart, PartOrder};
use crate::config::Sku;
use crate::fleet::error::FleetError;
use crate::fleet::fits::{self, SharedPart};
use crate::fleet::outbox::{self, Entry};
use crate::fleet::session::Session;
use crate::printable::on_one_line;

/// SKUs that are named when the fleet has lost their parts.
const NAMED: usize = 5;
/// Estimates of one moment by the clocks of two computers are not further apart, ms.
const SAME_MOMENT: u64 = 60_000;

impl Member {
    /// Announces the parts that were learned while the database was away, before those of others are taken.
    pub(super) async fn send_announcements(&self, session: &Session) -> Result<(), FleetError> {
        loop {
            let first =
                self.outbox().first_announcement().map_err(|error| FleetError::Outbox(error.to_string()))?;
            match first {
                Some((number, entry)) => self.send(session, number, &entry).await?,
                None => return Ok(()),
            }
        }
    }

    /// Takes the current parts of the fleet. Gives the SKUs of which this station has a part and the fleet has none, or an earlier
    /// one: the station is new there with what it learned before, or the database was made again, or from an older copy.
    pub(super) async fn read_all_parts(&self, session: &Session) -> Result<VecDeque<Sku>, FleetError> {
        let mut unseen = self.cache().skus().unwrap_or_else(|error| {
            tracing::warn!("the parts in the cache cannot be compared with those of the fleet: {error}");
            Default::default()
        });
        let mut lost = VecDeque::new();
        let mut after = String::new();
        loop {
            let (parts, last) = fits::page_of_parts(session, &after).await?;
            self.share_what_is_absent(session, &parts).await?;
            for theirs in parts {
                unseen.remove(theirs.sku.key());
                lost.extend(self.take_part_of_others(theirs));
            }
            match last {
                Some(last) if last > after => after = last,
                _ => break,
            }
        }
        lost.extend(unseen.into_values());
        if !lost.is_empty() {
            let named: Vec<&str> = lost.iter().take(NAMED).map(Sku::as_str).collect();
            let more = if lost.len() > NAMED { ", …" } else { "" };
            tracing::info!(
                "announcing parts that this station has and the fleet does not ({}): {}{more}",
                lost.len(),
                named.join(", ")
            );
        }
        Ok(lost)
    }

    /// Handles a part that the fleet announces.
    pub(super) async fn hear_of_part(&self, session: &Session, theirs: SharedPart) -> Result<(), FleetError> {
        match self.take_part_of_others(theirs) {
            Some(sku) => self.announce_again(session, &sku).await,
            None => Ok(()),
        }
    }

    /// Makes a part of the fleet the current one here, unless one that was learned here is still to be announced. Gives the SKU if
    /// the fleet is behind what it stated before.
    fn take_part_of_others(&self, theirs: SharedPart) -> Option<Sku> {
        let is_behind = self
            .cache()
            .current(&theirs.sku)
            .is_ok_and(|known| known.is_some_and(|known| is_behind(&theirs.part, &known)));
        if is_behind {
            return Some(theirs.sku);
        }
        self.adopt(theirs);
        None
    }

    fn adopt(&self, theirs: SharedPart) {
        let (cache, mut outbox) = (self.cache(), self.outbox());
        // An outbox that cannot be read may announce it.
        if !matches!(outbox.announces(&theirs.sku), Ok(false)) {
            return;
        }
        let before = cache.current(&theirs.sku);
        let is_same = |known: &CurrentPart| {
            known.origin == theirs.part.origin && known.has_frame == theirs.part.has_frame
        };
        let is_noted = |known: &CurrentPart| {
            let orders = known.order.zip(theirs.part.order);
            is_same(known)
                && orders.is_some_and(|(known, new)| {
                    (known.fleet_us, known.version, known.announced_us)
                        == (new.fleet_us, new.version, new.announced_us)
                        && known.learned_ms.abs_diff(new.learned_ms) < SAME_MOMENT
                })
        };
        if matches!(&before, Ok(Some(known)) if is_noted(known)) {
            return;
        }
        if let Err(error) = cache.make_current(&theirs.sku, &theirs.part) {
            tracing::warn!("the new part of {} cannot be noted in the cache: {error}", theirs.sku);
            return;
        }
        if let Ok(Some(known)) = &before
            && is_same(known)
        {
            // A station that has no surface of it may have announced it to a database that was lost.
            if known.order.map(|order| order.announced_us)
                != theirs.part.order.map(|order| order.announced_us)
            {
                std::mem::drop(outbox);
                self.share_all(&cache, &theirs.sku, known);
            }
            return;
        }
        if matches!(&before, Ok(Some(known)) if known.origin.blake3 != theirs.part.origin.blake3) {
            let (file, station) = (on_one_line(&theirs.part.origin.file), on_one_line(&theirs.station));
            tracing::info!("{} has a new part in the fleet: {file}, fitted by {station}", theirs.sku);
        }
        self.shared().news.insert(theirs.sku);
    }

    /// Announces the part of a SKU that the fleet has lost, with its surfaces. The one that was learned last is the current one
    /// then, whichever station announces its part first.
    pub(super) async fn announce_again(&self, session: &Session, sku: &Sku) -> Result<(), FleetError> {
        let cache = self.cache();
        // An outbox that cannot be read may announce it.
        let is_announced = !matches!(self.outbox().announces(sku), Ok(false));
        let Some((part, learned_ms)) = learned(&cache, sku).filter(|_| !is_announced) else { return Ok(()) };
        // Before the announcement: with it, the fleet has not lost the part any more.
        self.share_all(&cache, sku, &part);
        match fits::announce(session, &self.settings.name, sku, &part, outbox::age(learned_ms)).await {
            Err(error) if error.is_final() => {
                tracing::error!("the fleet does not accept the part of {sku}: {error}");
                return Ok(());
            }
            announced => announced?,
        };
        if let Some(current) = fits::current(session, sku.key()).await? {
            self.adopt(current);
        }
        Ok(())
    }

    /// Puts the surfaces of a part into the outbox; those that the fleet has are not sent.
    fn share_all(&self, cache: &Cache, sku: &Sku, part: &CurrentPart) {
        for key in cache.keys_of(sku, &part.origin.blake3).unwrap_or_default() {
            self.share(sku, &key, &part.origin);
        }
    }

    /// Puts the surfaces of parts of the fleet into the outbox that this station has and the fleet does not: somebody removed them.
    async fn share_what_is_absent(&self, session: &Session, parts: &[SharedPart]) -> Result<(), FleetError> {
        let cache = self.cache();
        let mut ours = Vec::new();
        for SharedPart { sku, part, .. } in parts {
            let keys = cache.keys_of(sku, &part.origin.blake3).unwrap_or_default();
            ours.extend(keys.into_iter().map(|key| (sku, key, &part.origin)));
        }
        let keys: Vec<&str> = ours.iter().map(|(_, key, _)| key.as_str()).collect();
        let absent = fits::absent(session, &keys).await?;
        for (sku, key, part) in
            ours.iter().filter(|(_, key, _)| absent.iter().any(|of_it| of_it == key.as_str()))
        {
            self.share(sku, key, part);
        }
        Ok(())
    }

    /// Puts the surface that another station needs into the outbox, if this station has it. The text may come from any login.
    pub(super) fn share_what_is_wanted(&self, text: &str) {
        let mut words = text.splitn(3, ' ');
        let (Some(key), Some(blake3), Some(sku)) = (words.next(), words.next(), words.next()) else { return };
        let Some(sku) = sku.parse::<Sku>().ok().filter(|parsed| parsed.key() == sku) else { return };
        let cache = self.cache();
        let Ok(Some(part)) = cache.current(&sku) else { return };
        if part.origin.blake3 != blake3 {
            return;
        }
        let keys = cache.keys_of(&sku, blake3).unwrap_or_default();
        if let Some(key) = keys.iter().find(|of_it| of_it.as_str() == key) {
            self.share(&sku, key, &part.origin);
        }
    }

    /// Sends an entry of the outbox, and removes it.
    pub(super) async fn send(&self, session: &Session, number: u64, entry: &Entry) -> Result<(), FleetError> {
        let current = match self.try_to_send(session, entry).await {
            Ok(current) => current,
            // It fails each time.
            Err(error) if error.is_final() => {
                tracing::error!("the fleet does not accept a message, which is removed: {error}");
                None
            }
            Err(error) => return Err(error),
        };
        self.outbox().remove(number);
        if let Some(current) = current {
            self.adopt(current);
        }
        Ok(())
    }

    /// Sends an entry. Gives the part that is current after an announcement.
    async fn try_to_send(&self, session: &Session, entry: &Entry) -> Result<Option<SharedPart>, FleetError> {
        let station = &self.settings.name;
        match entry {
            Entry::Fit { sku, key, part } => {
                let Ok(sku) = sku.parse::<Sku>() else { return Ok(None) };
                fits::send(session, &self.cache(), station, &sku, key, part).await?;
                Ok(None)
            }
            Entry::Learned { sku, part, at_ms } => {
                let Ok(sku) = sku.parse::<Sku>() else { return Ok(None) };
                let is_current = fits::announce(session, station, &sku, part, outbox::age(*at_ms)).await?;
                let current = fits::current(session, sku.key()).await?;
                if let Some(newer) = current.as_ref().filter(|_| !is_current) {
                    let [file, other, by] = [&part.origin.file, &newer.part.origin.file, &newer.station]
                        .map(|text| on_one_line(text));
                    tracing::warn!(
                        "{file} is not the part of {sku} any more: {by} has fitted {other} since. Drop {file} again if \
                         it is to replace that"
                    );
                }
                Ok(current)
            }
        }
    }
}

/// Whether the fleet's part comes before one that it stated earlier, or has its number and is another one. A fleet whose tables were made
/// since was lost, and has no earlier numbers. To another fleet, this station brings no order.
fn is_behind(theirs: &CurrentPart, known: &CurrentPart) -> bool {
    let is_behind = |(theirs, known): (PartOrder, PartOrder)| {
        (theirs.fleet_us == known.fleet_us && theirs.version <= known.version)
            || theirs.fleet_us > known.announced_us
    };
    theirs.order.zip(known.order).is_some_and(is_behind) && theirs.origin.blake3 != known.origin.blake3
}

/// The current part of a SKU in the cache, and when it was learned: ms since 1970 by the clock of this computer.
fn learned(cache: &Cache, sku: &Sku) -> Option<(CurrentPart, u64)> {
    let part = cache.current(sku).ok().flatten()?;
    let learned_ms = match part.order {
        Some(order) => order.learned_ms,
        None => cache.current_since_ms(sku).ok().flatten()?,
    };
    Some((part, learned_ms))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cache::PartOrigin;

    fn part(blake3: &str, fleet_us: i64, version: i64, announced_us: i64) -> CurrentPart {
        let origin = PartOrigin { file: "a.obj".into(), blake3: blake3.into() };
        CurrentPart::new(origin, false).in_order(PartOrder { fleet_us, version, announced_us, learned_ms: 0 })
    }

    #[test]
    fn only_a_fleet_that_was_lost_is_behind() {
        let known = part("aa", 10, 3, 50);
        let cases = [
            (part("bb", 10, 4, 60), false, "the next part"),
            (part("bb", 10, 2, 40), true, "restored from a dump"),
            (part("bb", 10, 3, 60), true, "restored from a dump, and another part was learned since"),
            (part("aa", 10, 2, 40), false, "the same part"),
            (part("bb", 55, 1, 60), true, "made again, and an earlier part was announced first"),
            (part("bb", 20, 1, 30), false, "another fleet, which this station joins"),
        ];
        for (theirs, expected, case) in cases {
            assert_eq!(is_behind(&theirs, &known), expected, "{case}");
        }
        assert!(
            !is_behind(&part("bb", 10, 1, 20), &CurrentPart { order: None, ..known }),
            "no order is known"
        );
    }
}
