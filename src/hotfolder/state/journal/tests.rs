use super::line::checksum;
use super::*;
use std::sync::Mutex;

fn id(drop: &str) -> DropId {
    DropId::from(drop.to_owned())
}

fn job(name: &str, key: &str) -> Job {
    let text = |text: &str| text.to_owned();
    Job {
        drop: id(name),
        sku: text("Can"),
        name: text(name),
        key: text(key),
        basis: text("b"),
        pattern: text("p"),
        result: text("r"),
    }
}

const STAMP: Stamp = Stamp { size: 7, modified: None, identity: 3 };

/// Everything that is remembered, for comparison.
fn state(journal: &Journal) -> (BTreeMap<DropId, OpenJob>, Results, BTreeMap<String, Refused>) {
    (journal.open.clone(), journal.results.clone(), journal.refused.clone())
}

#[test]
fn a_cut_journal_reads_as_the_lines_before_the_cut() {
    let folder = tempfile::tempdir().unwrap();
    let mut states = Vec::new();
    let mut journal = Journal::open(folder.path()).unwrap();
    let sku: Sku = "can".parse().unwrap();
    states.push((0, state(&journal)));
    for step in 0..6 {
        match step {
            0 => journal.delivering(&job("a.dxf", "1"), STAMP, Some(7)),
            1 => journal.delivered(&id("a.dxf"), Certainty::Uncertain),
            2 => journal.filing(&id("a.dxf"), "Can", STAMP, "(2)/a.dxf", None),
            3 => journal.done(&job("a.dxf", "1"), "(2)/a.dxf", Import::Done, Certainty::Uncertain),
            4 => journal.rejected(&id("can.glb"), "bad", "can.glb", Some(&sku)),
            _ => journal.delivering(&job("b.dxf", "2"), STAMP, Some(7)),
        }
        .unwrap();
        states.push((journal.length, state(&journal)));
    }
    assert!(journal.begun(&id("b.dxf"), STAMP).is_some());
    assert!(journal.begun(&id("b.dxf"), Stamp { size: 8, ..STAMP }).is_none(), "another file of that name");
    assert_eq!(journal.results_of(&sku, None, 9).0.len(), 1);
    assert_eq!(journal.uncertain().count(), 1);
    drop(journal);
    let whole = fs::read(folder.path().join(JOURNAL)).unwrap();
    for cut in 0..=whole.len() {
        fs::write(folder.path().join(JOURNAL), &whole[..cut]).unwrap();
        let expected = states.iter().rev().find(|(length, _)| *length <= cut as u64).unwrap();
        let journal = Journal::open(folder.path()).unwrap();
        assert_eq!(state(&journal), expected.1, "cut after {cut} bytes");
        drop(journal);
        assert_eq!(state(&Journal::open(folder.path()).unwrap()), expected.1, "rewritten after {cut} bytes");
    }
}

#[test]
fn damage_is_a_problem_until_the_copy_is_removed_and_a_cut_end_is_none() {
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path().join(JOURNAL);
    let mut journal = Journal::open(folder.path()).unwrap();
    for name in ["a.dxf", "b.dxf"] {
        journal.done(&job(name, "1"), name, Import::Done, Certainty::Certain).unwrap();
    }
    drop(journal);
    let whole = fs::read(&place).unwrap();
    let second = 1 + whole.iter().position(|byte| *byte == b'\n').unwrap();
    let mut flipped = whole.clone();
    flipped[second + 20] ^= 1;
    let zeros = vec![0; whole.len()];
    // The content, whether a status was written, the names that are known, and whether it is a problem.
    let cases: [(&[u8], bool, &[&str], bool); 7] = [
        (&whole, true, &["a.dxf", "b.dxf"], false),
        (&whole[..whole.len() - 5], true, &["a.dxf"], false),
        (&flipped, true, &["b.dxf"], true),
        (&zeros, true, &[], true),
        (&[], true, &[], true),
        // The first start of a station was interrupted.
        (&[], false, &[], false),
        (&whole[..20], false, &[], false),
    ];
    for (content, has_status, names, is_problem) in cases {
        fs::write(&place, content).unwrap();
        let status = folder.path().join(STATUS);
        if has_status {
            fs::write(status, "").unwrap()
        } else {
            fs::remove_file(status).unwrap_or_default()
        }
        for _ in 0..2 {
            let journal = Journal::open(folder.path()).unwrap();
            let known = journal.results.iter().map(|result| result.job.name);
            assert_eq!(known.collect::<Vec<_>>(), names);
            assert_eq!(journal.trouble().is_some(), is_problem, "{content:?}");
        }
        if is_problem {
            let copy = folder.path().join(DAMAGED);
            assert_eq!(fs::read(&copy).unwrap(), content);
            fs::remove_file(&copy).unwrap();
            assert_eq!(Journal::open(folder.path()).unwrap().trouble(), None, "{content:?}");
        }
    }
}

#[test]
fn an_original_is_removed_only_when_nothing_needs_it() {
    let folder = tempfile::tempdir().unwrap();
    let mut journal = Journal::open(folder.path()).unwrap();
    let sku: Sku = "can".parse().unwrap();
    for (name, import, certainty) in [
        ("due.dxf", Import::Due, Certainty::Certain),
        ("uncertain.dxf", Import::ByFolder, Certainty::Uncertain),
        ("done.dxf", Import::ByFolder, Certainty::Certain),
        ("busy.dxf", Import::ByFolder, Certainty::Certain),
    ] {
        journal.filing(&id(name), "Can", STAMP, name, Some((&job(name, "1"), certainty))).unwrap();
        assert!(!journal.remove_original(&sku, name, || Ok(())).unwrap(), "{name} is being filed");
        journal.done(&job(name, "1"), name, import, certainty).unwrap();
    }
    journal.began(&DropId::archived(&sku, "busy.dxf"), STAMP).unwrap();
    journal.delivering(&job("done.dxf", "2"), Stamp { size: 8, ..STAMP }, None).unwrap();
    for (place, is_removed) in [
        ("due.dxf", false),
        ("uncertain.dxf", false),
        ("busy.dxf", false),
        ("done.dxf", false),
        ("(2)/done.dxf", true),
        ("never-seen.dxf", false),
        ("(2)/never-seen.step", true),
    ] {
        assert_eq!(journal.remove_original(&sku, place, || Ok(())).unwrap(), is_removed, "{place}");
    }
    journal.cancelled(&id("done.dxf")).unwrap();
    let at = journal.result("done.dxf").unwrap().at.clone();
    let before = state(&journal);
    let full = || Err(io::ErrorKind::StorageFull.into());
    assert!(journal.remove_original(&sku, "done.dxf", full).is_err());
    assert_eq!(state(&journal), before, "an original that could not be removed is not forgotten");
    assert!(journal.remove_original(&sku, "done.dxf", || Ok(())).unwrap());
    drop(journal);
    let journal = Journal::open(folder.path()).unwrap();
    let result = journal.result("done.dxf").unwrap();
    assert_eq!((&*result.original, &result.at, &*result.job.key), ("", &at, "1"));
    assert_eq!(journal.result("due.dxf").unwrap().original, "due.dxf");
}

/// Two stations may deliver to one folder, and each must always recognize its own temporary files.
#[test]
fn a_station_keeps_its_own_tag() {
    let [one, other] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let mut journal = Journal::open(one.path()).unwrap();
    let tag = journal.tag().to_owned();
    assert_ne!(tag, Journal::open(other.path()).unwrap().tag());
    journal.delivering(&job("a.dxf", "1"), STAMP, Some(7)).unwrap();
    assert_eq!(Journal::open(one.path()).unwrap().tag(), tag);
    journal.rewrite().unwrap();
    assert_eq!(Journal::open(one.path()).unwrap().tag(), tag);
    // A station of an older version may have been interrupted.
    let older = written(&Line { at: clock::now(), record: Record::Cancelled { drop: id("a") } });
    fs::write(one.path().join(JOURNAL), older.unwrap()).unwrap();
    assert_eq!(Journal::open(one.path()).unwrap().tag(), tag_of_older(one.path()));
}

/// Two stations may deliver to one folder, and one must not remove the temporary files of the other.
#[test]
fn a_copy_of_a_state_folder_belongs_to_another_station() {
    let [one, other] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let mut journal = Journal::open(one.path()).unwrap();
    journal.delivering(&job("a.dxf", "1"), STAMP, Some(7)).unwrap();
    let tag = journal.tag().to_owned();
    fs::copy(one.path().join(JOURNAL), other.path().join(JOURNAL)).unwrap();
    let copy = Journal::open(other.path()).unwrap();
    assert_ne!(copy.tag(), tag);
    let open = copy.begun(&id("a.dxf"), STAMP).unwrap();
    let is_ours = matches!(&open.stage, Stage::Renaming { tag: its, .. } if *its == tag);
    assert!(is_ours, "its own temporary file is recognized: {open:?}");
    assert_eq!(Journal::open(other.path()).unwrap().tag(), copy.tag());
}

/// Machines without a battery start in 1970, until the network sets their clocks.
#[test]
fn a_clock_that_jumps_counts_no_crash_twice() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(JOURNAL);
    for round in 0..6 {
        let mut journal = Journal::open(folder.path()).unwrap();
        let deaths = journal.suspects().get(&id("a.obj")).map_or(0, |(_, deaths)| *deaths);
        assert_eq!(deaths, round.min(1));
        journal.began(&id("a.obj"), STAMP).unwrap();
        drop(journal);
        // All times are changed, as if the clock had jumped.
        let lines = fs::read_to_string(&path).unwrap();
        let other = lines.lines().map(|line| {
            let (_, json) = line.split_once(' ').unwrap();
            let at = json.find("\"at\":\"").unwrap() + 6;
            let json = format!("{}19{:02}-01-01T00:00:00Z{}", &json[..at], 70 + round, &json[at + 20..]);
            format!("{} {json}\n", checksum(&json))
        });
        fs::write(&path, other.collect::<String>()).unwrap();
    }
}

#[test]
fn crashes_are_counted_by_the_time_between_them() {
    let at = |boot: &str, seconds| Some(Uptime { boot: boot.into(), since: Duration::from_secs(seconds) });
    for (name, deaths, last, now, expected) in [
        ("the first one", 0, None, at("a", 5), true),
        ("soon after", 1, at("a", 5), at("a", 64), false),
        ("a minute after", 1, at("a", 5), at("a", 65), true),
        ("soon after another start of the machine", 1, at("a", 5), at("b", 30), true),
        ("soon after a start that is not distinguished", 1, at("", 50), at("", 30), false),
        ("the start is reported from now on", 1, at("", 5), at("b", 30), false),
        ("long after another start of the machine", 1, at("a", 5000), at("b", 60), true),
        ("an older version counted", 3, None, at("a", 5), true),
        ("the first one, with unknown uptime", 0, None, None, true),
        ("the second one, with unknown uptime", 1, None, None, false),
        ("the uptime was known before", 1, at("a", 5), None, false),
    ] {
        let at_work = AtWork { stamp: STAMP.into(), deaths, last_death: last, under_way: true };
        assert_eq!(is_new_death(&at_work, now.as_ref()), expected, "{name}");
    }
}

#[test]
fn crashes_are_counted_for_the_drops_being_processed() {
    let folder = tempfile::tempdir().unwrap();
    let open = || Journal::open(folder.path()).unwrap();
    let deaths = |journal: &Journal, drop: &str| journal.suspects().get(&id(drop)).map(|(_, deaths)| *deaths);
    drop(open());
    let at = "2026-01-01T00:00:00Z".to_owned();
    let died =
        Record::Died { drop: id("a.obj"), stamp: STAMP.into(), deaths: 1, boot: String::new(), uptime: None };
    let line = written(&Line { at, record: died }).unwrap();
    let text = fs::read_to_string(folder.path().join(JOURNAL)).unwrap() + &line;
    fs::write(folder.path().join(JOURNAL), text).unwrap();
    for count in [1, 2, 2] {
        let mut journal = open();
        assert_eq!((deaths(&journal, "a.obj"), deaths(&journal, "b.obj")), (Some(count), None));
        journal.began(&id("a.obj"), STAMP).unwrap();
        journal.began(&id("b.obj"), STAMP).unwrap();
        journal.ended(&id("b.obj")).unwrap();
    }
    let mut journal = open();
    assert_eq!(deaths(&journal, "a.obj"), Some(2), "once in a minute");
    journal.began(&id("a.obj"), Stamp { size: 8, ..STAMP }).unwrap();
    assert_eq!(deaths(&journal, "a.obj"), None, "another file of that name");
    journal.ended(&id("a.obj")).unwrap();
    assert!(open().suspects().is_empty());
}

#[test]
fn lines_of_a_newer_version_are_not_discarded() {
    let folder = tempfile::tempdir().unwrap();
    drop(Journal::open(folder.path()).unwrap());
    let path = folder.path().join(JOURNAL);
    let json = r#"{"at":"2030-01-01T00:00:00Z","did":"dreaming"}"#;
    let text = fs::read_to_string(&path).unwrap() + &format!("{} {json}\n", checksum(json));
    fs::write(&path, &text).unwrap();
    let Err(error) = Journal::open(folder.path()) else { panic!("it was read") };
    assert!(error.to_string().contains("newer version"), "{error}");
    assert_eq!(fs::read_to_string(&path).unwrap(), text);
}

/// If flushing the folder fails after the journal was replaced, the known length is wrong.
#[test]
fn a_replaced_journal_continues_at_its_end() {
    let folder = tempfile::tempdir().unwrap();
    let mut journal = Journal::open(folder.path()).unwrap();
    journal.done(&job("a.dxf", "1"), "a.dxf", Import::ByFolder, Certainty::Certain).unwrap();
    let (length, line) = (journal.length, fs::read(folder.path().join(JOURNAL)).unwrap());
    journal.done(&job("b.dxf", "1"), "b.dxf", Import::ByFolder, Certainty::Certain).unwrap();
    (journal.file, journal.length) = (None, 10 * length);
    fs::write(folder.path().join(JOURNAL), line).unwrap();
    journal.done(&job("c.dxf", "1"), "c.dxf", Import::ByFolder, Certainty::Certain).unwrap();
    let journal = Journal::open(folder.path()).unwrap();
    let names: Vec<_> = journal.results.iter().map(|result| result.job.name).collect();
    assert_eq!(names, ["a.dxf", "c.dxf"]);
}

#[test]
fn a_long_journal_is_rewritten_with_the_needed_records() {
    let folder = tempfile::tempdir().unwrap();
    let mut journal = Journal::open(folder.path()).unwrap();
    for round in 0..IDLE_LINES + 2 {
        journal.done(&job("a.dxf", &round.to_string()), "a.dxf", Import::Done, Certainty::Certain).unwrap();
    }
    journal.delivering(&job("b.dxf", "x"), STAMP, Some(7)).unwrap();
    let journal = Mutex::new(journal);
    keep_short(|| journal.lock().unwrap());
    let mut journal = journal.into_inner().unwrap();
    journal.done(&job("a.dxf", "last"), "a.dxf", Import::Due, Certainty::Certain).unwrap();
    let before = state(&journal);
    assert!(journal.lines < 100 && journal.length < 10_000, "{} lines", journal.lines);
    journal.delivered(&id("b.dxf"), Certainty::Certain).unwrap();
    drop(journal);
    let journal = Journal::open(folder.path()).unwrap();
    assert_eq!(journal.result("a.dxf"), before.1.get("a.dxf"));
    assert!(journal.begun(&id("b.dxf"), STAMP).unwrap().is_delivered());
}

#[test]
fn results_added_during_a_rewrite_are_not_lost() {
    const RESULTS: usize = 3000;
    let folder = tempfile::tempdir().unwrap();
    let mut journal = Journal::open(folder.path()).unwrap();
    let name = |number: usize| format!("{number:05}.dxf");
    let done = |journal: &mut Journal, number: usize, key: &str| {
        let name = name(number);
        journal.done(&job(&name, key), &name, Import::ByFolder, Certainty::Certain).unwrap();
    };
    for number in 0..RESULTS {
        done(&mut journal, number, "old");
    }
    journal.lines += IDLE_LINES + 2;
    let journal = Mutex::new(journal);
    // A job is done each time the journal is unlocked.
    let turn = std::cell::Cell::new(0);
    keep_short(|| {
        let mut guard = journal.lock().unwrap();
        let number = turn.replace(turn.get() + 1);
        if number > 1 {
            done(&mut guard, number * 100, "new");
            done(&mut guard, RESULTS + number, "new");
        }
        guard
    });
    let journal = journal.into_inner().unwrap();
    assert!(turn.get() > 10 && journal.lines < 2 * RESULTS, "{} turns, {} lines", turn.get(), journal.lines);
    let expected = state(&journal);
    drop(journal);
    assert_eq!(state(&Journal::open(folder.path()).unwrap()), expected);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "no temporary file remains");
}

/// The basis that an older version wrote cannot be compared.
#[test]
fn only_the_basis_of_an_older_version_is_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let mut journal = Journal::open(folder.path()).unwrap();
    for name in ["a.dxf", "busy.dxf", "lost.dxf"] {
        let original = if name == "lost.dxf" { "" } else { name };
        journal
            .filing(&id(name), "Can", STAMP, original, Some((&job(name, "1"), Certainty::Uncertain)))
            .unwrap();
        journal.done(&job(name, "1"), original, Import::Due, Certainty::Uncertain).unwrap();
    }
    // A drop that is being processed again must not be treated as done.
    journal.delivering(&job("busy.dxf", "2"), STAMP, Some(7)).unwrap();
    assert_eq!(journal.of_older_form(), 2);
    let before = journal.result("a.dxf").unwrap();
    let text = |basis: &str| basis.to_owned();
    let bases = || ["a.dxf", "busy.dxf", "lost.dxf", "none.dxf"].map(|name| (name, text("v2:77"))).to_vec();
    journal.rebase(bases()).unwrap();
    let after = Delivered { job: Job { basis: text("v2:77"), ..before.job.clone() }, ..before };
    for mut journal in [journal, Journal::open(folder.path()).unwrap()] {
        assert_eq!(journal.result("a.dxf").as_ref(), Some(&after));
        assert_eq!(journal.result("busy.dxf").unwrap().job.basis, "b");
        assert!(journal.begun(&id("busy.dxf"), STAMP).is_some());
        assert_eq!(journal.result("lost.dxf").unwrap().job.basis, "b");
        // It is not replaced a second time.
        journal.rebase(vec![("a.dxf", text("v2:88"))]).unwrap();
        assert_eq!(journal.result("a.dxf").as_ref(), Some(&after));
    }
}

/// Every order of the lines of one job gives one of the stages, even if a line was lost or an older version wrote it.
/// The rewritten journal gives the same stage.
#[test]
fn every_order_of_lines_gives_one_stage() {
    use Certainty::{Certain, Uncertain};
    let result = || job("a.dxf", "1");
    let delivering = || Record::Delivering {
        job: result(),
        stamp: STAMP.into(),
        import: Some(7),
        hot: Some(8),
        tag: "t".into(),
    };
    let delivered = |certainty| Record::Delivered { drop: id("a.dxf"), certainty };
    let filing = |certainty: Option<Certainty>| Record::Filing {
        drop: id("a.dxf"),
        sku: "Can".into(),
        stamp: STAMP.into(),
        to: "(2)/a.dxf".into(),
        job: certainty.map(|_| result()),
        certainty: certainty.unwrap_or_default(),
        hot: Some(8),
    };
    let renaming = || Stage::Renaming { result: result(), import: Some(7), tag: "t".into() };
    let at_delivered = |certainty| Stage::Delivered { result: result(), certainty };
    let at_filing = |certainty: Option<Certainty>| Stage::Filing {
        result: certainty.map(|certainty| (result(), certainty)),
        to: "(2)/a.dxf".into(),
    };
    let cases = [
        (vec![], None),
        (vec![delivering()], Some(renaming())),
        (vec![delivered(Certain)], None),
        (vec![delivering(), delivering()], Some(renaming())),
        (vec![delivering(), delivered(Certain)], Some(at_delivered(Certain))),
        (vec![delivering(), delivered(Uncertain)], Some(at_delivered(Uncertain))),
        (vec![delivering(), delivered(Certain), delivering()], Some(renaming())),
        (vec![delivering(), delivered(Certain), filing(Some(Certain))], Some(at_filing(Some(Certain)))),
        // An older version wrote a different certainty, or left out the drawing.
        (vec![delivering(), delivered(Uncertain), filing(Some(Certain))], Some(at_filing(Some(Uncertain)))),
        (vec![delivering(), delivered(Uncertain), filing(None)], Some(at_filing(Some(Uncertain)))),
        (vec![delivering(), delivered(Certain), filing(None)], Some(at_filing(Some(Certain)))),
        // The line between was lost on a full disk; only a delivered drawing is filed.
        (vec![delivering(), filing(Some(Uncertain))], Some(at_filing(Some(Uncertain)))),
        (vec![delivering(), filing(None)], Some(at_filing(Some(Certain)))),
        // An older version noted the delivery after that.
        (vec![delivering(), filing(None), delivered(Uncertain)], Some(at_filing(Some(Uncertain)))),
        // A drawing that is not delivered again, a part, and a pattern of an older version.
        (vec![filing(Some(Uncertain))], Some(at_filing(Some(Uncertain)))),
        (vec![filing(None)], Some(at_filing(None))),
        (vec![filing(None), delivered(Certain)], Some(at_filing(None))),
        (vec![filing(None), filing(Some(Certain))], Some(at_filing(Some(Certain)))),
        (vec![filing(Some(Certain)), filing(Some(Certain))], Some(at_filing(Some(Certain)))),
        (vec![delivering(), Record::Cancelled { drop: id("a.dxf") }], None),
    ];
    for (lines, expected) in cases {
        let folder = tempfile::tempdir().unwrap();
        let at = "2026-01-01T00:00:00Z";
        let text: String =
            lines.into_iter().map(|record| written(&Line { at: at.into(), record }).unwrap()).collect();
        fs::write(folder.path().join(JOURNAL), &text).unwrap();
        let mut journal = Journal::open(folder.path()).unwrap();
        let stage = |journal: &Journal| journal.begun(&id("a.dxf"), STAMP).map(|open| open.stage.clone());
        assert_eq!(stage(&journal), expected, "{text}");
        journal.rewrite().unwrap();
        let rewritten = stage(&Journal::open(folder.path()).unwrap());
        assert_eq!(rewritten, expected, "rewritten: {text}");
    }
}

#[test]
fn a_job_of_another_sender_ends_with_its_own_drop_only_and_survives_a_rewrite() {
    let folder = tempfile::tempdir().unwrap();
    let mut journal = Journal::open(folder.path()).unwrap();
    let (drop, claim, sku) = (id("a.dxf"), ("ab".repeat(32), 2), "can".parse::<Sku>().unwrap());
    let done = |journal: &mut Journal, key: &str| {
        journal.done(&job("a.dxf", key), "a.dxf", Import::ByFolder, Certainty::Certain).unwrap();
    };
    let again = |mut journal: Journal| {
        journal.rewrite().unwrap();
        std::mem::drop(journal);
        Journal::open(folder.path()).unwrap()
    };
    journal.offering(&id("b.dxf"), STAMP, "cups", "cd").unwrap();
    journal.arriving(&drop, &claim, false).unwrap();
    // A drop of that name that is not the job, which is still hidden.
    done(&mut journal, "1");
    journal.arrived(&drop).unwrap();
    // The lines about an older result of that name.
    assert!(journal.remove_original(&sku, "a.dxf", || Ok(())).unwrap());
    let mut journal = again(journal);
    let arrival = journal.arrival(&drop).unwrap();
    assert_eq!((&arrival.claim, arrival.is_drop), (&claim, true));
    assert_eq!(journal.unreported_jobs(9).len(), 0);
    done(&mut journal, "2");
    let mut journal = again(journal);
    assert!(journal.arrival(&drop).is_none());
    journal.job_reported(&(claim.0.clone(), 1)).unwrap();
    let ended = journal.unreported_jobs(9);
    assert_eq!((ended.len(), ended[0].1.attempt, ended[0].1.outcome.as_str()), (1, 2, "delivered"));
    journal.job_reported(&claim).unwrap();
    let mut journal = again(journal);
    assert_eq!(journal.unreported_jobs(9).len(), 0);
    assert!(journal.ended_job(&claim.0).is_some(), "it is recognised if it arrives again");
    assert_eq!(journal.offer(&id("b.dxf"), STAMP).map(|offer| offer.line.as_str()), Some("cups"));
    assert!(journal.offer(&id("b.dxf"), Stamp { size: 8, ..STAMP }).is_none(), "another file of that name");
    journal.handed_over(&id("b.dxf"), "cups", "cd").unwrap();
    assert!(again(journal).offer(&id("b.dxf"), STAMP).is_none());
}
