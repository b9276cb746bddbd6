//! The current part and surface of a SKU: from the cache, from the archive, or from a station that shares the cache.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{MutexGuard, PoisonError};

use super::standing::Standing;
use super::{EarlyEnd, Executor, Outcome, Task, basis, filing};
use crate::config::{FolderPaths, JobSettings, Sku};
use crate::formats::Pace;
use crate::hotfolder::api::{Corrector, JobError};
use crate::hotfolder::error::{guarded, warn_if_not_noted};
use crate::hotfolder::seen::folders;
use crate::hotfolder::state::Delivered;
use crate::reason::Reason;

/// The number of results that are read at a time, while no other job can use the journal.
const SLICE: usize = 200;

impl<C: Corrector> Executor<'_, C> {
    fn shapes(&self) -> MutexGuard<'_, BTreeMap<Sku, (JobSettings, String)>> {
        self.shapes.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Notes the identity of the SKU's part, if it was not noted for these settings or is `new`.
    pub(crate) fn note_shape(&self, sku: &Sku, settings: &JobSettings, new: bool) {
        let is_noted = self.shapes().get(sku).is_some_and(|(noted, _)| noted == settings);
        if (new || !is_noted)
            && let Ok(Some(name)) = guarded(|| self.corrector.part_identity(sku, settings))
        {
            self.shapes().insert(sku.clone(), (settings.clone(), name));
        }
    }

    /// The SKUs without a job whose part differs from the one that was last seen here: another station that shares the
    /// surfaces learned it.
    pub(crate) fn learned_elsewhere(&self, is_busy: impl Fn(&Sku) -> bool) -> Vec<Sku> {
        let mut changed = Vec::new();
        for (sku, (settings, last)) in self.shapes().iter_mut().filter(|(sku, _)| !is_busy(sku)) {
            if let Ok(Some(now)) = guarded(|| self.corrector.part_identity(sku, settings))
                && now != *last
            {
                *last = now;
                changed.push(sku.clone());
            }
        }
        changed
    }

    /// The identity of the SKU's part; `None` while it is unknown, or must be restored from the archive first.
    pub(crate) fn agreed_identity(
        &self,
        folders: &FolderPaths,
        sku: &Sku,
        settings: &JobSettings,
    ) -> Result<Option<String>, JobError> {
        match self.standing(folders, sku, settings, false)? {
            Standing::Agrees { .. } => self.identity(sku, settings),
            Standing::ArchiveIsNewer { .. } | Standing::Lost(_) | Standing::Unsure => Ok(None),
        }
    }

    /// The identity of the SKU's part in the cache; `None` while it is unknown.
    pub(crate) fn identity(&self, sku: &Sku, settings: &JobSettings) -> Result<Option<String>, JobError> {
        guarded(|| self.corrector.part_identity(sku, settings))
    }

    /// The basis of a drawing of the SKU that is made now; `None` while its part is unknown.
    pub(crate) fn basis(&self, sku: &Sku, settings: &JobSettings) -> Result<Option<String>, JobError> {
        Ok(self.identity(sku, settings)?.map(|part| basis::basis(&part, settings)))
    }

    /// The basis that the drawing of an archived original would have now.
    pub(crate) fn basis_of_original(&self, part: &str, original: &Path, settings: &JobSettings) -> String {
        basis::basis(part, &self.settings_of_original(original, settings))
    }

    /// Treats the delivered drawings of the SKU whose basis an older version wrote as up to date, before a part is
    /// learned: later changes make them outdated. If the part that they were made from is unknown, the new part makes
    /// them outdated.
    pub(crate) fn take_as_up_to_date(&self, folders: &FolderPaths, sku: &Sku, settings: &JobSettings) {
        let Ok(part) = self.agreed_identity(folders, sku, settings) else { return };
        let archive = folders.archive.join(sku.key());
        let mut last = None;
        loop {
            let (results, next) = self.journal().results_of(sku, last.as_deref(), SLICE);
            if next.is_none() {
                return;
            }
            if part.is_some() {
                self.rebase(&archive, &results, part.as_deref(), settings);
            } else {
                let older = results.iter().filter(|result| result.is_of_older_form());
                let bases = older.map(|result| (&*result.job.name, basis::of_unknown_part())).collect();
                warn_if_not_noted(self.journal().rebase(bases));
            }
            last = next;
        }
    }

    /// Does the same for some results; `part` is the identity of the SKU's part.
    pub(crate) fn rebase(
        &self,
        archive: &Path,
        results: &[Delivered],
        part: Option<&str>,
        settings: &JobSettings,
    ) {
        let Some(part) = part else { return };
        let older = results.iter().filter(|result| result.is_of_older_form());
        let present =
            |result: &Delivered| self.basis_of_original(part, &archive.join(&result.original), settings);
        let bases: Vec<_> = older.map(|result| (&*result.job.name, present(result))).collect();
        if !bases.is_empty() {
            warn_if_not_noted(self.journal().rebase(bases));
        }
    }

    /// Logs how many delivered drawings have a basis that an older version wrote.
    pub(crate) fn warn_of_older_form(&self) {
        let drawings = match self.journal().of_older_form() {
            0 => return,
            1 => "1 delivered drawing".to_owned(),
            more => format!("{more} delivered drawings"),
        };
        tracing::warn!(
            "treating {drawings} as up to date: an older version of isomark recorded part and settings in a form that \
             cannot be compared. Drop a drawing again if its part or settings changed while isomark was updated"
        );
    }

    /// Why the older part of the SKU is not used: its newest part was rejected and is still in the rejected folder.
    pub(crate) fn refused(&self, folders: &FolderPaths, sku: &Sku) -> Option<Reason> {
        let journal = self.journal();
        let refused = journal.refused(sku)?;
        let rejected = folders.rejected.join(&refused.to);
        if !matches!(folders::look(&rejected), Ok(Some(_))) {
            return None;
        }
        let what =
            format!("The new part {} of {sku} was rejected; the older part is not used.", refused.drop);
        let remedy = format!(
            "Drop a valid part of {sku}; or remove {} to continue with the older part.",
            rejected.display()
        );
        Some(Reason::new("part-rejected", what, remedy))
    }

    /// Fits the archived part of a SKU again, so that its delivered drawings can be checked. Nothing is rejected.
    pub(super) fn restore(&self, task: &Task, sku: &Sku) -> Result<Outcome, EarlyEnd> {
        match self.has_surface(&task.station.folders, sku, &task.settings, task.pace) {
            Ok(Surface::Known) => {
                self.note_shape(sku, &task.settings, false);
                Ok(Outcome::Restored)
            }
            Ok(Surface::Lost(reason)) => Ok(Outcome::NoSurface(reason)),
            Ok(Surface::Unknown) => {
                let what = format!("The archive has no part of SKU `{sku}` that can be fitted.");
                Ok(Outcome::NoSurface(Reason::new("waits-for-part", what, "Drop the part again.")))
            }
            Err(JobError::Rejected(reason)) => Ok(Outcome::NoSurface(reason)),
            Err(error) => Err(error.into()),
        }
    }

    /// Whether there is a surface for the SKU's current part; a lost one is fitted again from the archived part, also if the
    /// cache has that of an older part.
    pub(crate) fn has_surface(
        &self,
        folders: &FolderPaths,
        sku: &Sku,
        settings: &JobSettings,
        pace: Pace,
    ) -> Result<Surface, JobError> {
        let is_known = || {
            let standing = self.standing(folders, sku, settings, true)?;
            let is_known = matches!(standing, Standing::Agrees { .. })
                && guarded(|| Ok(self.corrector.knows(sku, settings)))?;
            Ok::<_, JobError>((standing, is_known))
        };
        if let (_, true) = is_known()? {
            return Ok(Surface::Known);
        }
        // Drawings of one SKU are corrected in parallel, and the job of one of them fits the part.
        let _claim = self.restoring.claim(sku, pace)?;
        let since = match is_known()? {
            (_, true) => return Ok(Surface::Known),
            (Standing::Lost(reason), _) => return Ok(Surface::Lost(reason)),
            (Standing::Agrees { since }, _) => since,
            (Standing::ArchiveIsNewer { since }, _) => {
                tracing::warn!(
                    "the cache has an older part of {sku} than the archive: it may be an older copy, or another version of isomark \
                     has worked here. The archived part is used"
                );
                Some(since)
            }
            (Standing::Unsure, _) => None,
        };
        let Some(part) = filing::current_part(folders, sku) else { return Ok(Surface::Unknown) };
        let attempt = (part, settings.clone(), since);
        let unfit = || self.unfit_archive.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, why)) = unfit().get(sku).filter(|(unfit, _)| *unfit == attempt) {
            return Ok(why.clone().map_or(Surface::Unknown, Surface::Lost));
        }
        let Some((file, _)) = self.read_archived(&attempt.0)? else { return Ok(Surface::Unknown) };
        match guarded(|| self.corrector.restore_part(sku, &file, settings, since, pace)) {
            Ok(learned) => {
                let hash = guarded(|| Ok(self.corrector.part_hash(&file)))?;
                self.note_part(folders, sku, &attempt.0, &hash);
                tracing::info!("restored the surface of {sku} from the archive: {}", learned.summary);
                Ok(Surface::Known)
            }
            Err(JobError::Rejected(reason)) => {
                tracing::warn!(
                    "the surface of {sku} cannot be restored from the archive: {}",
                    reason.on_one_line()
                );
                // With the code of all drawings that wait for a part.
                let why = (reason.code == "newer-elsewhere").then(|| {
                    let what = format!("The drawing waits for a part: {}", continued(&reason.what));
                    Reason::new("waits-for-part", what, reason.remedy)
                });
                unfit().insert(sku.clone(), (attempt, why.clone()));
                Ok(why.map_or(Surface::Unknown, Surface::Lost))
            }
            Err(other) => Err(other),
        }
    }
}

/// A sentence behind a colon.
fn continued(sentence: &str) -> String {
    let first = sentence.chars().next();
    first.map_or_else(String::new, |first| first.to_lowercase().chain(sentence.chars().skip(1)).collect())
}

/// Whether the surface of a SKU's current part is known.
pub(crate) enum Surface {
    Known,
    Unknown,
    /// The current part itself was removed, for this reason.
    Lost(Reason),
}
