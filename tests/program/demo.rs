//! `isomark demo`, the README's first command.

use crate::desk::Desk;
use crate::station::files;

#[test]
fn the_demo_delivers_every_drop_and_lists_the_results() {
    let desk = Desk::new();
    let mut first = Vec::new();
    for run in 1..=2 {
        let output = desk.isomark(&["demo"]);
        assert_eq!(output.code, 0, "run {run}: {}", output.err);
        assert!(output.out.contains("7 drawings delivered, 0 rejected."), "{}", output.out);
        let rows: Vec<&str> = output.out.lines().filter(|line| line.contains(" -> ")).collect();
        assert_eq!(rows.len(), 7, "{}", output.out);
        for (sku, drawing, method) in [
            ("mouse", "letters.dxf", "isometric"),
            ("mouse", "guilloche.dxf", "isometric"),
            ("can", "letters.dxf", "cylinder"),
            ("can", "logo.dxf", "cylinder"),
            ("can", "band.dxf", "cylinder"),
            ("can", "code.dxf", "cylinder"),
            ("mandarin", "letters.dxf", "isometric"),
        ] {
            let words = |row: &&&str| {
                let mut words = row.split_whitespace();
                words.next() == Some(sku) && words.next() == Some(drawing) && words.next() == Some(method)
            };
            assert!(rows.iter().any(|row| words(&row)), "{sku} {drawing} {method}: {}", output.out);
        }
        // The printed command works even if the program is not on the path.
        let next = output.out.lines().last().unwrap().trim();
        assert!(next.contains(env!("CARGO_BIN_EXE_isomark")) && next.contains(" watch "), "{next}");
        let demo = desk.path("isomark-demo");
        assert!(files(&demo.join("hot")).is_empty() && files(&demo.join("rejected")).is_empty());
        let import = files(&demo.join("import"));
        assert_eq!(import.len(), 7);
        // The logo is filled, its frame is not.
        let logo = desk.text("isomark-demo/import/can@logo.dxf");
        assert!(logo.contains("Logo-fill") && !logo.contains("Frame-fill"));
        // The band goes round the can in tiles.
        let band = desk.text("isomark-demo/import/can@band.dxf");
        assert!(band.contains("R+000.000 DIAMONDS") && band.contains("R-105.000 BORDER"));
        let reports = files(&demo.join("reports"));
        assert_eq!(reports.iter().filter(|name| name.ends_with(".preview.svg")).count(), 7);
        assert_eq!(reports.iter().filter(|name| name.ends_with(".on-part.glb")).count(), 7);
        let page = output.out.lines().find(|line| line.ends_with(".report.html")).unwrap();
        assert!(desk.text(page.trim()).contains("id=\"mark-on-part\""), "{page}");
        // The folders in the table exist.
        for line in
            output.out.lines().filter(|line| line.starts_with("corrected") || line.starts_with("reports"))
        {
            assert!(desk.path(line.split_whitespace().last().unwrap()).is_dir(), "{line}");
        }
        let bytes: Vec<Vec<u8>> =
            import.iter().map(|name| desk.read(&format!("isomark-demo/import/{name}"))).collect();
        if run == 2 {
            assert!(first == bytes, "the second run must deliver the same bytes");
        }
        first = bytes;
    }
    opens_its_report(&desk);
    // A file with the name of the folder is an error with a remedy.
    desk.write("taken", "a file");
    desk.isomark(&["demo", "taken"]).refused(3, &["taken", "what to do: "]);
}

/// A stand-in for the desktop's program that opens files writes down what it is given.
#[cfg(target_os = "linux")]
fn opens_its_report(desk: &Desk) {
    use std::os::unix::fs::PermissionsExt;

    let (opener, opened) = (desk.path("bin/xdg-open"), desk.path("opened.txt"));
    desk.write(
        "bin/xdg-open",
        format!("#!/bin/sh\nprintf %s \"$1\" > '{}.part'\nmv '{0}.part' '{0}'\n", opened.display()),
    );
    std::fs::set_permissions(&opener, std::fs::Permissions::from_mode(0o755)).unwrap();
    let path = std::env::join_paths([desk.path("bin"), "/usr/bin".into(), "/bin".into()]).unwrap();
    let status = std::process::Command::new(env!("CARGO_BIN_EXE_isomark"))
        .args(["demo", "--open"])
        .current_dir(desk.root())
        .env("PATH", path)
        .stdout(std::process::Stdio::null())
        .status();
    assert!(status.unwrap().success());
    let until = std::time::Instant::now() + std::time::Duration::from_secs(30);
    while !opened.exists() && std::time::Instant::now() < until {
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    let page = desk.path("isomark-demo/reports/mouse/mouse@letters.dxf.report.html");
    assert_eq!(desk.text("opened.txt"), page.to_str().unwrap());
}

#[cfg(not(target_os = "linux"))]
fn opens_its_report(_: &Desk) {}
