//! Entries of a ZIP archive, stored or deflated (PKWARE, APPNOTE 6.3.10), as far as 3MF packages use them.
//!
//! The directory at the end is checked before an entry is opened. Entries are decompressed as streams with a limit, because
//! a few kilobytes can claim gigabytes.

use std::collections::BTreeMap;
use std::io::{self, Read};

use super::{MeshFormat, MeshReadError};

/// Largest number of entries.
const MAX_ENTRIES: u64 = 10_000;
/// How many times longer than its compressed data an entry may be, beyond [`FREE_BYTES`].
const MAX_RATIO: u64 = 100;
/// Length that every entry may have, bytes.
const FREE_BYTES: u64 = 16 << 20;
/// Length of the record at the end of an archive, without its comment, bytes.
const END_RECORD: usize = 22;
const FORMAT: MeshFormat = MeshFormat::ThreeMf;

/// The directory of an archive.
pub(super) struct Package<'a> {
    bytes: &'a [u8],
    /// By name, in lower case and without a slash at the start.
    entries: BTreeMap<String, Entry>,
}

#[derive(Clone, Copy)]
struct Entry {
    method: u16,
    is_encrypted: bool,
    crc: u32,
    compressed: u64,
    length: u64,
    header: u64,
}

/// The name under which an entry is found.
pub(super) fn entry_name(name: &str) -> String {
    name.trim_start_matches('/').replace('\\', "/").to_ascii_lowercase()
}

impl<'a> Package<'a> {
    /// Reads the directory of an archive.
    ///
    /// # Errors
    /// When the directory is missing, as in a file that is cut off, or not valid.
    pub(super) fn open(bytes: &'a [u8]) -> Result<Self, MeshReadError> {
        let end = end_record(bytes).ok_or_else(cut_off)?;
        let short = |at| u16_at(bytes, at).map(u64::from).ok_or_else(cut_off);
        let long = |at| u32_at(bytes, at).map(u64::from).ok_or_else(cut_off);
        let (mut count, mut start) = (short(end + 10)?, long(end + 16)?);
        if let Some((more, at)) = large_end_record(bytes, end) {
            (count, start) = (more, at);
        }
        if count > MAX_ENTRIES {
            return Err(MeshReadError::TooLarge { what: "entries", count, limit: MAX_ENTRIES });
        }
        let mut entries = BTreeMap::new();
        let mut at = usize::try_from(start).unwrap_or(usize::MAX);
        for number in 0..count {
            let damaged = || damaged("its directory", format!("entry {number} is not valid"));
            let (name, entry, next) = directory_entry(bytes, at).ok_or_else(damaged)?;
            entries.insert(entry_name(&name), entry);
            at = next;
        }
        Ok(Self { bytes, entries })
    }

    /// The names of the entries, as [`entry_name`] returns them.
    pub(super) fn names(&self) -> impl Iterator<Item = &str> {
        self.entries.keys().map(String::as_str)
    }

    /// The content of an entry, as a stream that fails if it is damaged or longer than its compressed data explain.
    ///
    /// # Errors
    /// When there is no such entry, or its place, encryption or compression does not allow reading it.
    pub(super) fn entry(&self, name: &str) -> Result<impl Read + 'a, MeshReadError> {
        let problem = |problem: &str| damaged(name, problem.into());
        let entry =
            *self.entries.get(&entry_name(name)).ok_or_else(|| problem("the package does not contain it"))?;
        if entry.is_encrypted {
            return Err(problem("it is encrypted"));
        }
        let data = entry.data(self.bytes).ok_or_else(|| problem("its data are not in the file"))?;
        let content: Box<dyn Read + 'a> = match entry.method {
            0 => Box::new(data),
            8 => Box::new(flate2::read::DeflateDecoder::new(data)),
            _ => return Err(problem("its compression is not Deflate")),
        };
        let limit = FREE_BYTES.saturating_add(entry.compressed.saturating_mul(MAX_RATIO));
        Ok(Checked { content, crc: flate2::Crc::new(), entry, limit })
    }
}

impl Entry {
    fn data<'a>(&self, bytes: &'a [u8]) -> Option<&'a [u8]> {
        let at = usize::try_from(self.header).ok()?;
        if bytes.get(at..)?.get(..4)? != b"PK\x03\x04" {
            return None;
        }
        let names = usize::from(u16_at(bytes, at + 26)?) + usize::from(u16_at(bytes, at + 28)?);
        bytes.get(at + 30 + names..)?.get(..usize::try_from(self.compressed).ok()?)
    }
}

/// The content of an entry, whose length and checksum are compared with the directory at its end.
struct Checked<'a> {
    content: Box<dyn Read + 'a>,
    crc: flate2::Crc,
    entry: Entry,
    limit: u64,
}

impl Read for Checked<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if buffer.is_empty() {
            return Ok(0);
        }
        let count = self.content.read(buffer)?;
        self.crc.update(&buffer[..count]);
        self.limit = self
            .limit
            .checked_sub(count as u64)
            .ok_or_else(|| io::Error::other("it is over 100 times as long as its compressed data"))?;
        // The checksum covers the length modulo 2^32.
        if count == 0 && (self.crc.sum() != self.entry.crc || self.crc.amount() != self.entry.length as u32) {
            return Err(io::Error::other("its checksum or length is wrong"));
        }
        Ok(count)
    }
}

/// The error for an archive that ends before its directory.
fn cut_off() -> MeshReadError {
    MeshReadError::CutShort { format: FORMAT, what: "directories at its end".into(), declared: 1, actual: 0 }
}

/// The error for a part of a package.
pub(super) fn damaged(item: &str, problem: String) -> MeshReadError {
    MeshReadError::Package { item: item.into(), byte: None, problem }
}

/// Where the record at the end begins; the comment after it may contain anything.
fn end_record(bytes: &[u8]) -> Option<usize> {
    let last = bytes.len().checked_sub(END_RECORD)?;
    let first = last.saturating_sub(usize::from(u16::MAX));
    (first..=last).rev().find(|&at| {
        bytes[at..].starts_with(b"PK\x05\x06")
            && u16_at(bytes, at + 20)
                .is_some_and(|comment| at + END_RECORD + usize::from(comment) <= bytes.len())
    })
}

/// Number of entries and place of the directory in an archive with 64-bit sizes.
fn large_end_record(bytes: &[u8], end: usize) -> Option<(u64, u64)> {
    let locator = end.checked_sub(20)?;
    if bytes.get(locator..)?.get(..4)? != b"PK\x06\x07" {
        return None;
    }
    let at = usize::try_from(u64_at(bytes, locator + 8)?).ok()?;
    if bytes.get(at..)?.get(..4)? != b"PK\x06\x06" {
        return None;
    }
    Some((u64_at(bytes, at.checked_add(32)?)?, u64_at(bytes, at.checked_add(48)?)?))
}

/// A name and its entry of the directory, and where the next one begins.
fn directory_entry(bytes: &[u8], at: usize) -> Option<(String, Entry, usize)> {
    let record = bytes.get(at..)?;
    if record.get(..4)? != b"PK\x01\x02" {
        return None;
    }
    let short = |offset| u16_at(record, offset);
    let long = |offset| u32_at(record, offset).map(u64::from);
    let [name, extra, comment] = [28, 30, 32].map(|offset| short(offset).map(usize::from));
    let (name, extra, comment) = (name?, extra?, comment?);
    let mut sizes = [long(24)?, long(20)?, long(42)?];
    let text = record.get(46..46 + name)?;
    large_sizes(record.get(46 + name..46 + name + extra)?, &mut sizes)?;
    let [length, compressed, header] = sizes;
    let entry = Entry {
        method: short(10)?,
        is_encrypted: short(8)? & 1 != 0,
        crc: u32_at(record, 16)?,
        compressed,
        length,
        header,
    };
    Some((String::from_utf8_lossy(text).into_owned(), entry, at + 46 + name + extra + comment))
}

/// Replaces the sizes that do not fit into 32 bits by those of the extra field.
fn large_sizes(mut extra: &[u8], sizes: &mut [u64; 3]) -> Option<()> {
    while extra.len() >= 4 {
        let (kind, length) = (u16_at(extra, 0)?, usize::from(u16_at(extra, 2)?));
        let field = extra.get(4..4 + length)?;
        if kind == 1 {
            let large = sizes.iter_mut().filter(|size| **size == u64::from(u32::MAX));
            for (size, at) in large.zip((0..).step_by(8)) {
                *size = u64_at(field, at)?;
            }
        }
        extra = &extra[4 + length..];
    }
    Some(())
}

fn u16_at(bytes: &[u8], at: usize) -> Option<u16> {
    bytes.get(at..)?.first_chunk().map(|two| u16::from_le_bytes(*two))
}

fn u32_at(bytes: &[u8], at: usize) -> Option<u32> {
    bytes.get(at..)?.first_chunk().map(|four| u32::from_le_bytes(*four))
}

fn u64_at(bytes: &[u8], at: usize) -> Option<u64> {
    bytes.get(at..)?.first_chunk().map(|eight| u64::from_le_bytes(*eight))
}
