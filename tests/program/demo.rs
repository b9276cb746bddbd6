//! `isomark demo`, the README's first command.

use crate::desk::Desk;
use crate::station::files;

#[test]
fn the_demo_delivers_every_drop_and_says_where() {
    let desk = Desk::new();
    let mut first = Vec::new();
    for run in 1..=2 {
        let said = desk.isomark(&["demo"]);
        assert_eq!(said.code, 0, "run {run}: {}", said.err);
        assert!(said.out.contains("6 drawings delivered, 0 rejected."), "{}", said.out);
        let rows: Vec<&str> = said.out.lines().filter(|line| line.contains(" -> ")).collect();
        assert_eq!(rows.len(), 6, "{}", said.out);
        for (sku, drawing, method) in [
            ("mouse", "letters.dxf", "isometric"),
            ("mouse", "guilloche.dxf", "isometric"),
            ("can", "letters.dxf", "cylinder"),
            ("can", "logo.dxf", "cylinder"),
            ("can", "code.dxf", "cylinder"),
            ("mandarin", "letters.dxf", "isometric"),
        ] {
            let words = |row: &&&str| {
                let mut words = row.split_whitespace();
                words.next() == Some(sku) && words.next() == Some(drawing) && words.next() == Some(method)
            };
            assert!(rows.iter().any(|row| words(&row)), "{sku} {drawing} {method}: {}", said.out);
        }
        // The program need not lie on the path to go on.
        let next = said.out.lines().last().unwrap().trim();
        assert!(next.contains(env!("CARGO_BIN_EXE_isomark")) && next.contains(" watch "), "{next}");
        let demo = desk.path("isomark-demo");
        assert!(files(&demo.join("hot")).is_empty() && files(&demo.join("rejected")).is_empty());
        let import = files(&demo.join("import"));
        assert_eq!(import.len(), 6);
        let reports = files(&demo.join("reports"));
        assert_eq!(reports.iter().filter(|name| name.ends_with(".preview.svg")).count(), 6);
        // The folders that the table names are there.
        for line in
            said.out.lines().filter(|line| line.starts_with("corrected") || line.starts_with("reports"))
        {
            assert!(desk.path(line.split_whitespace().last().unwrap()).is_dir(), "{line}");
        }
        let bytes: Vec<Vec<u8>> =
            import.iter().map(|name| desk.read(&format!("isomark-demo/import/{name}"))).collect();
        if run == 2 {
            assert!(first == bytes, "the second run delivers the same bytes");
        }
        first = bytes;
    }
    // Where there is no room for a folder, the message says so.
    desk.write("taken", "a file");
    desk.isomark(&["demo", "taken"]).refused(3, &["taken", "remedy: "]);
}
