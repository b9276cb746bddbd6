//! How a job continues after an interruption: a pure function of the journal's stage and the files on the disk.
//!
//! A drawing is flushed in the import folder under a temporary name before the journal records `delivering`, and gets
//! its final name after that. So the folder decides whether it was delivered. Nothing is filed before that is known.

use crate::config::DeliveryKind;
use crate::formats::mesh::MeshFormat;
use crate::hotfolder::state::{Certainty, Import, Stage};

/// What is found about a job that was interrupted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Evidence {
    pub(crate) original: Original,
    pub(crate) import: InImport,
    pub(crate) kind: DeliveryKind,
}

/// Where the original is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Original {
    /// In the hot folder, and its job runs now; `copied` if a copy is at the place where it was to be filed.
    AtHand { inputs: Inputs, copied: bool },
    /// No longer in the hot folder; `filed` if a file is at the place where it was to be filed.
    Gone { filed: bool },
    /// In the archive, where originals are corrected again; no job runs on it.
    InArchive,
    /// Not in the hot folder, which was replaced by a different folder.
    OutOfSight,
}

/// How the inputs of the job compare with those before the interruption.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Inputs {
    Same,
    /// The part or the settings changed.
    Changed,
    /// The drop is a different file.
    AnotherFile,
}

/// The state of the import folder for a drawing that was about to get its final name there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct InImport {
    /// Its temporary file exists.
    pub(crate) temporary: bool,
    pub(crate) result: Seen,
    /// The folder was not replaced by a different one.
    pub(crate) same_folder: bool,
    /// The folder is on another computer, which may have renamed a file although it reported a failure.
    pub(crate) on_network: bool,
}

/// The file with the drawing's name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Seen {
    Nothing,
    Ours,
    /// Another drawing, which was to be replaced, or one that was not compared.
    Another,
}

/// How the job continues.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Resume {
    /// It waits: this folder is not available.
    Wait(Hidden),
    /// It was not delivered, or must be made again: the journal forgets it.
    Redo,
    /// A job without a drawing is done from the start; with `copied`, its original is only removed at the end.
    Refile { copied: bool },
    /// The drawing was delivered, and the remaining steps are done; with `report`, the report can be made again.
    Finish { certainty: Certainty, import: Import, report: bool, copied: bool },
    /// Only the journal's last line about the drawing is missing.
    NoteDrawing { certainty: Certainty, import: Import },
    /// Only the journal's last line about the part is missing.
    NotePart,
}

/// A folder that is not available after an interruption.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Hidden {
    /// The import folder is a different one, such as the mount point of a share that is not mounted.
    Import,
    /// The hot folder is a different one.
    Drop,
}

/// Whether the drawing got its final name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Renamed {
    Yes,
    No,
    /// Either it did, and was taken away; or its temporary file was removed before.
    Unknown,
    /// The folder is a different one now.
    NotVisible,
}

/// Decides how the job continues.
pub(crate) fn after_a_crash(stage: &Stage, seen: Evidence) -> Resume {
    let Evidence { original, import, kind } = seen;
    if original == Original::OutOfSight {
        return Resume::Wait(Hidden::Drop);
    }
    let is_filed = matches!(stage, Stage::Filing { .. });
    let certainty = match stage {
        Stage::Renaming { .. } => match (renamed(import), kind) {
            (Renamed::NotVisible, _) => return Resume::Wait(Hidden::Import),
            // Nobody takes drawings from BeamServer's folder: a missing drawing is made again.
            (Renamed::No, _) | (Renamed::Unknown, DeliveryKind::Beamserver) => return Resume::Redo,
            (Renamed::Yes, _) => Certainty::Certain,
            (Renamed::Unknown, DeliveryKind::Folder) => Certainty::Uncertain,
        },
        Stage::Delivered { certainty, .. } => *certainty,
        Stage::Filing { result: Some((_, certainty)), .. } => *certainty,
        Stage::Filing { result: None, to } => {
            return match original {
                Original::AtHand { copied, .. } => Resume::Refile { copied },
                Original::Gone { filed: true } if MeshFormat::from_name(to).is_some() => Resume::NotePart,
                _ => Resume::Redo,
            };
        }
    };
    let held = match kind {
        DeliveryKind::Folder => Import::ByFolder,
        // An original is filed only after its drawing was imported into BeamConstruct.
        DeliveryKind::Beamserver if is_filed => Import::Done,
        DeliveryKind::Beamserver => Import::Due,
    };
    match original {
        Original::AtHand { inputs: Inputs::AnotherFile, .. } => Resume::Redo,
        // BeamServer would look for a missing drawing.
        Original::AtHand { .. } if held == Import::Due && import.result == Seen::Nothing => Resume::Redo,
        Original::AtHand { inputs, copied } => {
            Resume::Finish { certainty, import: held, report: inputs == Inputs::Same, copied }
        }
        Original::Gone { .. } | Original::InArchive | Original::OutOfSight => {
            Resume::NoteDrawing { certainty, import: held }
        }
    }
}

/// Whether the drawing got its final name, from the import folder after an interruption.
fn renamed(seen: InImport) -> Renamed {
    match seen {
        InImport { temporary: true, .. } => Renamed::No,
        InImport { same_folder: false, .. } => Renamed::NotVisible,
        InImport { result: Seen::Ours, .. } => Renamed::Yes,
        // The renamed drawing would have replaced it.
        InImport { result: Seen::Another, .. } => Renamed::No,
        InImport { result: Seen::Nothing, .. } => Renamed::Unknown,
    }
}

/// Whether the drawing got its final name, from the import folder after the system reported that renaming failed.
pub(crate) fn after_a_failed_rename(seen: InImport) -> Renamed {
    match renamed(seen) {
        // On a local disk, a failed rename was not done: somebody removed the temporary file.
        Renamed::Unknown if !seen.on_network => Renamed::No,
        renamed => renamed,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hotfolder::state::{DropId, Job};
    use DeliveryKind::{Beamserver, Folder};
    use Seen::{Another, Nothing, Ours};

    fn result() -> Job {
        let [sku, name, key, basis, pattern, result] = Default::default();
        Job { drop: DropId::Hot("can.dxf".into()), sku, name, key, basis, pattern, result }
    }

    fn renaming() -> Stage {
        Stage::Renaming { result: result(), import: Some(1), tag: String::new() }
    }

    fn delivered(certainty: Certainty) -> Stage {
        Stage::Delivered { result: result(), certainty }
    }

    fn filing(certainty: Certainty) -> Stage {
        Stage::Filing { result: Some((result(), certainty)), to: "can.dxf".into() }
    }

    fn without_result(to: &str) -> Stage {
        Stage::Filing { result: None, to: to.into() }
    }

    const fn at_hand(inputs: Inputs, copied: bool) -> Original {
        Original::AtHand { inputs, copied }
    }

    const SAME: Original = at_hand(Inputs::Same, false);
    const CHANGED: Original = at_hand(Inputs::Changed, false);
    const ANOTHER_FILE: Original = at_hand(Inputs::AnotherFile, false);
    const COPIED: Original = at_hand(Inputs::Same, true);
    const GONE: Original = Original::Gone { filed: false };
    const FILED: Original = Original::Gone { filed: true };
    const IN_ARCHIVE: Original = Original::InArchive;
    const OUT_OF_SIGHT: Original = Original::OutOfSight;

    const fn finish(certainty: Certainty, import: Import) -> Resume {
        Resume::Finish { certainty, import, report: true, copied: false }
    }

    const fn note(certainty: Certainty, import: Import) -> Resume {
        Resume::NoteDrawing { certainty, import }
    }

    const SURE: Certainty = Certainty::Certain;
    const PERHAPS: Certainty = Certainty::Uncertain;
    const BARE: Resume =
        Resume::Finish { certainty: SURE, import: Import::ByFolder, report: false, copied: false };
    const REMOVE_ONLY: Resume =
        Resume::Finish { certainty: SURE, import: Import::ByFolder, report: true, copied: true };
    const WAIT_FOR_IMPORT: Resume = Resume::Wait(Hidden::Import);
    const WAIT_FOR_HOT: Resume = Resume::Wait(Hidden::Drop);

    /// The state of the import folder: whether the temporary file exists, the file with the drawing's name, and whether
    /// it is the same folder as before.
    type Folders = (bool, Seen, bool);

    /// Name, stage, and how the job continues for each place of the original.
    type Case<'a> = (&'a str, Stage, DeliveryKind, Folders, &'a [(Original, Resume)]);

    const NEVER_RENAMED: Folders = (true, Nothing, true);
    const NEVER_REPLACED: Folders = (true, Another, true);
    const RENAMED: Folders = (false, Ours, true);
    const TAKEN: Folders = (false, Nothing, true);
    const OTHER_DRAWING: Folders = (false, Another, true);
    const OTHER_FOLDER: Folders = (false, Ours, false);

    #[test]
    fn a_job_continues_according_to_the_files_found() {
        use Import::{ByFolder, Done, Due};
        use Resume::{NotePart, Redo};
        let cases: &[Case] = &[
            (
                "not renamed",
                renaming(),
                Folder,
                NEVER_RENAMED,
                &[
                    (SAME, Redo),
                    (CHANGED, Redo),
                    (ANOTHER_FILE, Redo),
                    (GONE, Redo),
                    (IN_ARCHIVE, Redo),
                    (OUT_OF_SIGHT, WAIT_FOR_HOT),
                ],
            ),
            (
                "not renamed over an older one",
                renaming(),
                Folder,
                NEVER_REPLACED,
                &[(SAME, Redo), (GONE, Redo)],
            ),
            (
                "renamed",
                renaming(),
                Folder,
                RENAMED,
                &[
                    (SAME, finish(SURE, ByFolder)),
                    (CHANGED, BARE),
                    (ANOTHER_FILE, Redo),
                    (GONE, note(SURE, ByFolder)),
                    (IN_ARCHIVE, note(SURE, ByFolder)),
                    (OUT_OF_SIGHT, WAIT_FOR_HOT),
                ],
            ),
            (
                "taken away, or never renamed",
                renaming(),
                Folder,
                TAKEN,
                &[
                    (SAME, finish(PERHAPS, ByFolder)),
                    (ANOTHER_FILE, Redo),
                    (GONE, note(PERHAPS, ByFolder)),
                    (IN_ARCHIVE, note(PERHAPS, ByFolder)),
                ],
            ),
            ("an older drawing remained", renaming(), Folder, OTHER_DRAWING, &[(SAME, Redo), (GONE, Redo)]),
            (
                "another import folder",
                renaming(),
                Folder,
                OTHER_FOLDER,
                &[
                    (SAME, WAIT_FOR_IMPORT),
                    (ANOTHER_FILE, WAIT_FOR_IMPORT),
                    (GONE, WAIT_FOR_IMPORT),
                    (IN_ARCHIVE, WAIT_FOR_IMPORT),
                    (OUT_OF_SIGHT, WAIT_FOR_HOT),
                ],
            ),
            (
                "renamed for BeamServer",
                renaming(),
                Beamserver,
                RENAMED,
                &[(SAME, finish(SURE, Due)), (GONE, note(SURE, Due)), (IN_ARCHIVE, note(SURE, Due))],
            ),
            (
                "missing in BeamServer's folder",
                renaming(),
                Beamserver,
                TAKEN,
                &[(SAME, Redo), (GONE, Redo), (IN_ARCHIVE, Redo)],
            ),
            (
                "delivered",
                delivered(SURE),
                Folder,
                TAKEN,
                &[
                    (SAME, finish(SURE, ByFolder)),
                    (CHANGED, BARE),
                    (ANOTHER_FILE, Redo),
                    (GONE, note(SURE, ByFolder)),
                    (IN_ARCHIVE, note(SURE, ByFolder)),
                    (OUT_OF_SIGHT, WAIT_FOR_HOT),
                ],
            ),
            (
                "delivered into another folder",
                delivered(SURE),
                Folder,
                OTHER_FOLDER,
                &[(SAME, finish(SURE, ByFolder)), (GONE, note(SURE, ByFolder))],
            ),
            (
                "perhaps delivered",
                delivered(PERHAPS),
                Folder,
                RENAMED,
                &[(SAME, finish(PERHAPS, ByFolder)), (GONE, note(PERHAPS, ByFolder))],
            ),
            (
                "delivered for BeamServer",
                delivered(SURE),
                Beamserver,
                OTHER_DRAWING,
                &[(SAME, finish(SURE, Due)), (GONE, note(SURE, Due)), (IN_ARCHIVE, note(SURE, Due))],
            ),
            (
                "delivered, and missing in BeamServer's folder",
                delivered(SURE),
                Beamserver,
                TAKEN,
                &[(SAME, Redo), (GONE, note(SURE, Due)), (IN_ARCHIVE, note(SURE, Due))],
            ),
            (
                "about to be filed",
                filing(SURE),
                Folder,
                TAKEN,
                &[
                    (SAME, finish(SURE, ByFolder)),
                    (CHANGED, BARE),
                    (ANOTHER_FILE, Redo),
                    (COPIED, REMOVE_ONLY),
                    (GONE, note(SURE, ByFolder)),
                    (FILED, note(SURE, ByFolder)),
                    (OUT_OF_SIGHT, WAIT_FOR_HOT),
                ],
            ),
            (
                "filed, perhaps delivered",
                filing(PERHAPS),
                Folder,
                TAKEN,
                &[(SAME, finish(PERHAPS, ByFolder)), (FILED, note(PERHAPS, ByFolder))],
            ),
            (
                "filed after the import",
                filing(SURE),
                Beamserver,
                TAKEN,
                &[(SAME, finish(SURE, Done)), (FILED, note(SURE, Done))],
            ),
            (
                "a part about to be filed",
                without_result("(2)/can.glb"),
                Folder,
                TAKEN,
                &[
                    (SAME, Resume::Refile { copied: false }),
                    (COPIED, Resume::Refile { copied: true }),
                    (GONE, Redo),
                    (FILED, NotePart),
                    (OUT_OF_SIGHT, WAIT_FOR_HOT),
                ],
            ),
            (
                "a pattern that an older version filed",
                without_result("can.dxf"),
                Folder,
                TAKEN,
                &[(SAME, Resume::Refile { copied: false }), (GONE, Redo), (FILED, Redo)],
            ),
        ];
        for (name, stage, kind, (temporary, result, same_folder), originals) in cases {
            for (original, expected) in *originals {
                let (temporary, result, same_folder) = (*temporary, *result, *same_folder);
                let import = InImport { temporary, result, same_folder, on_network: false };
                let seen = Evidence { original: *original, import, kind: *kind };
                assert_eq!(after_a_crash(stage, seen), *expected, "{name}, {original:?}");
            }
        }
    }

    /// In every case, no drawing is made twice and none is lost.
    #[test]
    fn no_case_delivers_twice_or_forgets_a_delivery() {
        let flags = [false, true];
        let certainties = [SURE, PERHAPS];
        let stages = std::iter::once(renaming())
            .chain(certainties.map(delivered))
            .chain(certainties.map(filing))
            .chain(["can.glb", "can.dxf"].map(without_result));
        let inputs = [Inputs::Same, Inputs::Changed, Inputs::AnotherFile];
        let at_hand = inputs.iter().flat_map(|inputs| flags.map(|copied| at_hand(*inputs, copied)));
        let originals: Vec<Original> = at_hand.chain([GONE, FILED, IN_ARCHIVE, OUT_OF_SIGHT]).collect();
        let mut count = 0;
        for stage in stages {
            for (original, kind) in
                originals.iter().flat_map(|one| [Folder, Beamserver].map(|kind| (*one, kind)))
            {
                for result in [Nothing, Ours, Another] {
                    for bits in 0..8 {
                        let [temporary, same_folder, on_network] = [1, 2, 4].map(|bit| bits & bit != 0);
                        let import = InImport { temporary, result, same_folder, on_network };
                        let resume = after_a_crash(&stage, Evidence { original, import, kind });
                        let is_redone = resume == Resume::Redo;
                        let is_another =
                            matches!(original, Original::AtHand { inputs: Inputs::AnotherFile, .. });
                        match &stage {
                            Stage::Renaming { .. } if original == OUT_OF_SIGHT => {}
                            Stage::Renaming { .. } if temporary => assert!(is_redone),
                            Stage::Renaming { .. } if same_folder && result == Ours => {
                                assert_eq!(is_redone, is_another);
                            }
                            Stage::Renaming { .. } if !same_folder => assert_eq!(resume, WAIT_FOR_IMPORT),
                            Stage::Delivered { .. } if kind == Folder => assert_eq!(is_redone, is_another),
                            Stage::Filing { result: Some(_), .. } => assert_eq!(is_redone, is_another),
                            _ => {}
                        }
                        assert_eq!(resume == WAIT_FOR_HOT, original == OUT_OF_SIGHT);
                        count += 1;
                    }
                }
            }
        }
        assert_eq!(count, 7 * 10 * 2 * 3 * 8);
    }

    #[test]
    fn the_import_folder_decides_whether_a_drawing_was_delivered() {
        use Renamed::{No, NotVisible, Unknown, Yes};
        for (name, result, [temporary, same_folder, on_network], crash, failed) in [
            ("not renamed yet", Nothing, [true, true, false], No, No),
            ("not renamed yet over the same", Ours, [true, true, false], No, No),
            ("not renamed, in a different folder", Nothing, [true, false, false], No, No),
            ("renamed", Ours, [false, true, false], Yes, Yes),
            ("taken away, or never renamed", Nothing, [false, true, false], Unknown, No),
            ("the same on a share", Nothing, [false, true, true], Unknown, Unknown),
            ("the older one was not replaced", Another, [false, true, false], No, No),
            ("the same on a share", Another, [false, true, true], No, No),
            ("another folder", Nothing, [false, false, false], NotVisible, NotVisible),
            ("another folder with the same drawing", Ours, [false, false, true], NotVisible, NotVisible),
            ("another folder with another drawing", Another, [false, false, false], NotVisible, NotVisible),
        ] {
            let seen = InImport { temporary, result, same_folder, on_network };
            assert_eq!((renamed(seen), after_a_failed_rename(seen)), (crash, failed), "{name}");
        }
    }
}
