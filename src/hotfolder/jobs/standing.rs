//! Whether the cache and the station agree on the current part of a SKU.
//!
//! The cache is not the truth: it may be an older copy, another version of isomark may have used the archive since, and a
//! station that shares it may have learned a newer part. The part that became the SKU's part last is the current one,
//! wherever it was dropped.

use std::collections::BTreeMap;
use std::path::Path;

use super::{Executor, filing, intake};
use crate::config::{FolderPaths, JobSettings, Sku};
use crate::files::written_at_ms;
use crate::hotfolder::api::{Completeness, Corrector, DroppedFile, JobError, PartNow};
use crate::hotfolder::error::{folder_trouble, guarded};
use crate::hotfolder::seen::folders;
use crate::hotfolder::state::PartNote;
use crate::reason::Reason;

/// The standing of the cache's current part of a SKU.
pub(super) enum Standing {
    /// The cache has the newest part, or none. If the archived one is the newest, too, it became the SKU's part at this moment, ms
    /// since 1970.
    Agrees { since: Option<u64> },
    /// The archived part is newer than that of the cache; it became the SKU's part at this moment.
    ArchiveIsNewer { since: u64 },
    /// The part that was used last is neither in the cache nor in the archive.
    Lost(Reason),
    /// The archived part would have to be read.
    Unsure,
}

impl<C: Corrector> Executor<'_, C> {
    /// Compares the cache's current part of the SKU with the archive, and with the part that was used last. `may_read` allows to
    /// read the archived part, which may be large; it is only necessary after another version of isomark has worked here.
    pub(super) fn standing(
        &self,
        folders: &FolderPaths,
        sku: &Sku,
        settings: &JobSettings,
        may_read: bool,
    ) -> Result<Standing, JobError> {
        // A primitive is given in the settings.
        if settings.part.primitive.is_some() {
            return Ok(Standing::Agrees { since: None });
        }
        let now = match guarded(|| self.corrector.part_now(sku))? {
            PartNow::Untold => return Ok(Standing::Agrees { since: None }),
            PartNow::Unknown => None,
            PartNow::Known { file, blake3, learned_ms, is_recorded } => {
                Some((PartNote { file, blake3, learned_ms, ..PartNote::default() }, is_recorded))
            }
        };
        let (archived, filed_ms) = match filing::current_part(folders, sku) {
            Some(part) => (filing::in_archive(folders, sku, &part), filed_ms(folders, sku)?),
            None => (String::new(), 0),
        };
        let noted = PartNote::read(&folders.state, sku).map_err(folder_trouble)?;
        let is_as_noted = |noted: &&PartNote| noted.archived == archived && noted.filed_ms == filed_ms;
        let archived_blake3 = match noted.as_ref().filter(is_as_noted) {
            Some(noted) => noted.archived_blake3.clone(),
            _ if archived.is_empty() => String::new(),
            _ if !may_read => return Ok(Standing::Unsure),
            _ => self.hash_of_archived(&folders.archive.join(sku.key()).join(&archived))?,
        };
        // A copy of the archive may have changed the time.
        let is_as_noted = noted.as_ref().is_some_and(|noted| noted.archived_blake3 == archived_blake3);
        let last = match noted {
            _ if !is_as_noted && !archived_blake3.is_empty() => {
                // Another version has filed the part since, and has left no other moment.
                let file =
                    Path::new(&archived).file_name().unwrap_or_default().to_string_lossy().into_owned();
                let of_archive = PartNote {
                    file,
                    blake3: archived_blake3.clone(),
                    learned_ms: filed_ms,
                    ..PartNote::default()
                };
                match noted {
                    Some(noted) if noted.learned_ms > filed_ms => Some(noted),
                    _ => Some(of_archive),
                }
            }
            noted => noted,
        };
        let in_full = |note: PartNote| PartNote {
            archived: archived.clone(),
            filed_ms,
            archived_blake3: archived_blake3.clone(),
            ..note
        };
        let (now, is_recorded, last) = match (now, last) {
            (None, None) => return Ok(Standing::Agrees { since: None }),
            (None, Some(last)) => {
                let last = in_full(last);
                return Ok(match last.is_archived() || archived.is_empty() {
                    true => Standing::Agrees { since: last.is_archived().then_some(last.learned_ms) },
                    false => Standing::Lost(lost(sku, &last.file, None)),
                });
            }
            (Some((now, is_recorded)), None) => (now, is_recorded, None),
            (Some((now, is_recorded)), Some(last)) => {
                let is_newer = now.learned_ms > last.learned_ms && (is_recorded || !is_as_noted);
                match now.blake3 == last.blake3 || is_newer {
                    true => (now, is_recorded, Some(last)),
                    false => {
                        let last = in_full(last);
                        return Ok(match last.is_archived() {
                            true => Standing::ArchiveIsNewer { since: last.learned_ms },
                            false => Standing::Lost(lost(sku, &last.file, Some(&now.file))),
                        });
                    }
                }
            }
        };
        // An older copy of the cache may have the same part with an earlier moment.
        let learned_ms = match last {
            Some(last) if last.blake3 == now.blake3 => now.learned_ms.max(last.learned_ms),
            _ => now.learned_ms,
        };
        let note = in_full(PartNote { learned_ms, ..now });
        keep(&note, folders, sku);
        if may_read && !is_recorded {
            // From now on, a part of an older version is known to be newer.
            guarded(|| self.corrector.record_part(sku))?;
        }
        // The archived part may be an older one.
        Ok(Standing::Agrees { since: note.is_archived().then_some(learned_ms) })
    }

    /// Notes that the SKU's part is the archived one with this hash, if it is the cache's current one now.
    pub(super) fn note_part(&self, folders: &FolderPaths, sku: &Sku, archived: &Path, archived_blake3: &str) {
        let Ok(PartNow::Known { file, blake3, learned_ms, .. }) = guarded(|| self.corrector.part_now(sku))
        else {
            return;
        };
        let Ok(filed_ms) = filed_ms(folders, sku) else { return };
        let (archived, archived_blake3) =
            (filing::in_archive(folders, sku, archived), archived_blake3.into());
        let note = PartNote { file, blake3, learned_ms, archived, filed_ms, archived_blake3 };
        keep(&note, folders, sku);
    }

    /// The hash of an archived part with the files that it needs; empty if it cannot be used.
    fn hash_of_archived(&self, path: &Path) -> Result<String, JobError> {
        let Some((file, is_whole)) = self.read_archived(path)? else { return Ok(String::new()) };
        if is_whole { guarded(|| Ok(self.corrector.part_hash(&file))) } else { Ok(String::new()) }
    }

    /// An archived part with the files that it needs, and whether all are there; `None` if it does not exist.
    pub(super) fn read_archived(&self, path: &Path) -> Result<Option<(DroppedFile, bool)>, JobError> {
        let Some((bytes, _)) = folders::read_whole(path).map_err(folder_trouble)? else { return Ok(None) };
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let (siblings, is_whole) = match guarded(|| Ok(self.corrector.completeness(&name, &bytes)))? {
            Completeness::Whole { companions } => {
                let siblings = intake::read_needed(path, &companions)?;
                let is_whole =
                    intake::needed(&companions).all(|companion| siblings.contains_key(&companion.name));
                (siblings, is_whole)
            }
            Completeness::CutShort(_) => (BTreeMap::new(), false),
        };
        Ok(Some((DroppedFile { name, bytes, siblings }, is_whole)))
    }
}

/// Keeps a note. Without it, the part is found out again.
fn keep(note: &PartNote, folders: &FolderPaths, sku: &Sku) {
    if let Err(error) = note.write(&folders.state, sku) {
        tracing::debug!("the part of {sku} is not noted: {error}");
    }
}

/// When the archive got to name its part of the SKU, ms since 1970.
fn filed_ms(folders: &FolderPaths, sku: &Sku) -> Result<u64, JobError> {
    let filed = written_at_ms(&filing::current_part_note(folders, sku)).map_err(folder_trouble)?;
    Ok(filed.unwrap_or_default())
}

/// Why drawings of a SKU wait whose last part was removed; with `older`, the cache has another part.
fn lost(sku: &Sku, last: &str, older: Option<&str>) -> Reason {
    let what = match older {
        Some(older) => format!(
            "The drawing waits for a part: the cache has {older} for SKU `{sku}`, but {last}, which became its part later, was used \
             last. The cache may be an older copy."
        ),
        None => format!(
            "The drawing waits for a part: {last}, the part of SKU `{sku}` that was used last, is no longer in the cache, and was not \
             dropped at this station."
        ),
    };
    let remedy = format!(
        "Drop the part of {sku} that is to be used, here or at a station that shares the cache. It is used from then on."
    );
    Reason::new("waits-for-part", what, remedy)
}
