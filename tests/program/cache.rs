//! The cache: kept surfaces, damaged entries, and `isomark cache`.

use fs_err as fs;

use crate::desk::{Desk, drawing, notices, part};

fn with_mouse() -> Desk {
    let desk = Desk::new();
    let report = desk.correct(&part("mouse/fc020-gui.glb"), &drawing("abc"), "--sku mouse --cache kept");
    assert_eq!(report["part"]["surface_from_cache"], false);
    desk
}

/// The only kept surface.
fn entry(desk: &Desk) -> std::path::PathBuf {
    let files = fs::read_dir(desk.path("kept/v39/mouse")).unwrap().map(|entry| entry.unwrap().path());
    let fits: Vec<_> = files.filter(|path| path.extension().is_some_and(|ending| ending == "fit")).collect();
    assert_eq!(fits.len(), 1);
    fits[0].clone()
}

fn damage(desk: &Desk) {
    let entry = entry(desk);
    let mut bytes = fs::read(&entry).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 0x40;
    fs::write(entry, bytes).unwrap();
}

#[test]
fn a_known_sku_needs_no_part() {
    let desk = with_mouse();
    let (mouse, abc) = (part("mouse/fc020-gui.glb"), drawing("abc"));
    let again = desk.isomark(&["correct", &mouse, &abc, "--sku", "mouse", "--cache", "kept", "-o", "2.dxf"]);
    assert!(again.code == 0 && again.err.contains("from the cache"), "{again:?}");
    let report = desk.correct_to("3.dxf", &[&abc], "--sku mouse --cache kept");
    assert_eq!(report["part"]["surface_from_cache"], true);
    assert_eq!(report["part"]["file"], "fc020-gui.glb");
    assert!(desk.read("out.dxf") == desk.read("2.dxf") && desk.read("out.dxf") == desk.read("3.dxf"));
    // Another side needs another surface, which is not in the cache.
    let options = ["correct", &abc, "--sku", "mouse", "--cache", "kept", "--facing", "+x", "-o", "4.dxf"];
    desk.isomark(&options).refused(1, &["SKU mouse", "under these settings", "what to do: Name the part"]);
}

#[test]
fn without_a_folder_for_surfaces_only_a_part_that_is_not_given_is_missing() {
    let desk = Desk::new();
    let run = |arguments: &[&str]| {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_isomark"));
        for variable in ["XDG_CACHE_HOME", "HOME", "LOCALAPPDATA"] {
            command.env_remove(variable);
        }
        command.args(arguments).current_dir(desk.root()).output().unwrap()
    };
    let (mouse, abc) = (part("mouse/fc020-gui.glb"), drawing("abc"));
    for given in [&["correct", &mouse, &abc][..], &["correct", &abc, "--cylinder", "73,180", "--axis", "x"]] {
        let output = run(&[given, &["-o", "out.dxf"]].concat());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let left: Vec<_> =
            fs::read_dir(desk.root()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        assert_eq!(left, ["out.dxf"]);
        fs::remove_file(desk.path("out.dxf")).unwrap();
    }
    let output = run(&["correct", &abc, "--sku", "mouse", "-o", "out.dxf"]);
    let shown = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{shown}");
    assert!(shown.contains("--cache"), "{shown}");
}

#[test]
fn a_damaged_surface_is_reported_and_fitted_again() {
    let desk = with_mouse();
    damage(&desk);
    // Without the part the surface cannot be fitted again, and the message must not state that the SKU is unknown.
    let lost =
        desk.isomark(&["correct", &drawing("abc"), "--sku", "mouse", "--cache", "kept", "-o", "lost.dxf"]);
    lost.refused(1, &["mouse", "damaged", "what to do: Name the part"]);
    let report = desk.correct_to(
        "2.dxf",
        &[&part("mouse/fc020-gui.glb"), &drawing("abc")],
        "--sku mouse --cache kept",
    );
    assert!(notices(&report).contains(&"cache-damaged"), "{report:#}");
    assert_eq!(report["part"]["surface_from_cache"], false);
    assert_eq!(desk.read("out.dxf"), desk.read("2.dxf"));
    let report = desk.correct_to("3.dxf", &[&drawing("abc")], "--sku mouse --cache kept");
    assert_eq!(report["part"]["surface_from_cache"], true);
}

#[test]
fn the_cache_is_listed_verified_and_cleaned() {
    let desk = with_mouse();
    let cache = |words: &[&str]| desk.isomark(&[&["cache"], words, &["--cache", "kept"]].concat());
    let list = cache(&["list"]);
    assert_eq!(list.code, 0);
    assert!(
        list.out.starts_with("* mouse ") && list.out.contains("fc020-gui.glb, largest residual 0."),
        "{}",
        list.out
    );
    cache(&["verify"]).refused(0, &["1 entry, 0 damaged"]);

    damage(&desk);
    let verify = cache(&["verify"]);
    verify.refused(1, &["1 entry, 1 damaged", "cache verify --repair"]);
    assert!(verify.out.starts_with("mouse "), "{}", verify.out);
    assert!(cache(&["list"]).out.contains("damaged: "));
    cache(&["verify", "--repair"]).refused(0, &["1 entry, 1 damaged, removed"]);
    cache(&["verify"]).refused(0, &["0 entries, 0 damaged"]);

    let report = desk.correct(&part("mouse/fc020-gui.glb"), &drawing("abc"), "--sku mouse --cache kept");
    assert_eq!(report["part"]["surface_from_cache"], false);
    cache(&["remove", "mouse", "cat"]).refused(0, &["mouse: removed", "cat has no fitted surface here"]);
    assert_eq!(cache(&["list"]).out, "");
    cache(&["remove", "a:b"]).refused(2, &["`a:b`", "what to do: Rename it"]);
    cache(&["remove"]).refused(2, &["Usage"]);
    for verb in [&["list"][..], &["verify"], &["remove", "mouse"]] {
        desk.isomark(&[&["cache"], verb, &["--cache", "nope"]].concat())
            .refused(2, &["There is no folder", "nope", "`--cache`"]);
    }
    assert!(!desk.path("nope").exists());
}
