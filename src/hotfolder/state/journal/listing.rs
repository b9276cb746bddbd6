//! Lists of products whose drawings are put into the hot folder, and the serial numbers of each SKU.

use super::line::{Listing, Record, Series};
use super::{DropId, Journal};
use crate::config::{SerialSettings, Sku};
use crate::hotfolder::seen::Stamp;

/// A list that is about to be divided into its rows.
pub(crate) struct NewListing<'a> {
    pub(crate) sku: &'a Sku,
    pub(crate) stamp: Stamp,
    pub(crate) list: String,
    pub(crate) rows: u64,
    pub(crate) date: String,
}

impl Journal {
    /// How many serial numbers of the series are used for the SKU. With another first number, a new series begins; with another
    /// distance it goes on behind the last number.
    pub(crate) fn serials_used(&self, sku: &Sku, serial: &SerialSettings) -> u64 {
        let series = self.serials.get(sku.key()).filter(|series| series.start == serial.start);
        match series {
            None => 0,
            Some(series) if series.step == serial.step || series.used == 0 => series.used,
            Some(series) => {
                let last = (series.used - 1).saturating_mul(series.step);
                (last / serial.step.max(1)).saturating_add(1)
            }
        }
    }

    /// The serial numbers of the SKU's last series.
    pub(crate) fn series(&self, sku: &Sku) -> Option<Series> {
        self.serials.get(sku.key()).copied()
    }

    /// Adds numbers that are used and that the journal does not know; returns whether there are any. The first number in the
    /// settings decides which of two series goes on.
    pub(crate) fn take_series(&mut self, sku: &Sku, found: Series, serial: &SerialSettings) -> bool {
        let is_news = match self.series(sku) {
            None => true,
            Some(known) if known.start == found.start => found.last() > known.last(),
            Some(known) => known.start != serial.start && found.start == serial.start,
        };
        if is_news {
            self.serials.insert(sku.key().to_owned(), found);
        }
        is_news
    }

    /// The first number of the SKU's last series, if it is another one.
    pub(crate) fn older_series(&self, sku: &Sku, serial: &SerialSettings) -> Option<u64> {
        self.serials.get(sku.key()).map(|series| series.start).filter(|start| *start != serial.start)
    }

    /// The list that was begun on exactly this drawing.
    pub(crate) fn listing(&self, drop: &DropId, stamp: Stamp) -> Option<&Listing> {
        self.listings.get(drop).filter(|listing| listing.stamp.is_of(stamp))
    }

    /// Reserves a serial number for each row of a list: from now on no other list gets them.
    pub(crate) fn reserve(
        &mut self,
        drop: &DropId,
        new: NewListing<'_>,
        serial: &SerialSettings,
    ) -> std::io::Result<Listing> {
        let NewListing { sku, stamp, list, rows, date } = new;
        let listing = Listing {
            stamp: stamp.into(),
            sku: sku.as_str().into(),
            list,
            start: serial.start,
            step: serial.step,
            used: self.serials_used(sku, serial),
            rows,
            date,
            named: 0,
        };
        self.append(Record::Listing { drop: drop.clone(), listing: listing.clone() }, true)?;
        Ok(listing)
    }

    /// Notes that the first `named` drawings of a list are flushed under hidden names and are about to get their names.
    pub(crate) fn naming(&mut self, drop: &DropId, named: u64) -> std::io::Result<()> {
        self.append(Record::Naming { drop: drop.clone(), named }, true)
    }

    /// Notes that the drawings of all rows are in the hot folder, and the list is filed.
    pub(crate) fn listed(&mut self, drop: &DropId) -> std::io::Result<()> {
        self.append(Record::Listed { drop: drop.clone() }, false)
    }

    /// The records of lists that are still needed.
    pub(super) fn listing_records(&self) -> impl Iterator<Item = Record> {
        let series = self.serials.iter().map(|(sku, series)| Record::Serials {
            sku: sku.clone(),
            start: series.start,
            step: series.step,
            used: series.used,
        });
        let listings = self
            .listings
            .iter()
            .map(|(drop, listing)| Record::Listing { drop: drop.clone(), listing: listing.clone() });
        // A list that was begun may be older than the last series of its SKU.
        listings.chain(series)
    }

    pub(super) fn apply_listing(&mut self, drop: DropId, listing: Listing) {
        if let Ok(sku) = listing.sku.parse::<Sku>() {
            let Listing { start, step, used, rows, .. } = listing;
            let series = Series { start, step, used: used.saturating_add(rows) };
            self.serials.insert(sku.key().to_owned(), series);
        }
        self.listings.insert(drop, listing);
    }
}
