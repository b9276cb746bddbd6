//! Files that a command writes take the place of no file that it reads, and of no device.

use crate::desk::{Desk, drawing, part};

const CAN: &[&str] = &["correct", "--cylinder", "100,120", "--place", "0,0"];

/// A desk with a drawing of this name, and its bytes.
fn desk(name: &str) -> (Desk, Vec<u8>) {
    let desk = Desk::new();
    let bytes = std::fs::read(drawing("square")).unwrap();
    desk.write(name, &bytes);
    (desk, bytes)
}

#[test]
fn a_list_does_not_overwrite_its_drawing() {
    let (desk, before) = desk("out/order-0002.dxf");
    desk.write("order.csv", "LOT\nA\nB\n");
    let of_list = ["out/order-0002.dxf", "--list", "order.csv", "--out-dir", "out"];
    desk.isomark(&[CAN, &of_list].concat()).refused(2, &["order-0002.dxf, which is also read"]);
    assert_eq!(desk.read("out/order-0002.dxf"), before);
    assert!(!desk.path("out/order-0001.dxf").exists());
    let elsewhere = ["out/order-0002.dxf", "--list", "order.csv", "--out-dir", "elsewhere"];
    let output = desk.isomark(&[CAN, &elsewhere].concat());
    assert_eq!(output.code, 0, "{output:?}");
    assert_ne!(desk.read("elsewhere/order-0002.dxf"), before);
}

#[test]
fn a_step_of_focus_does_not_overwrite_the_drawing() {
    let (desk, before) = desk("plain.dxf");
    let steps =
        ["--set", "focus.steps=layers", "--set", "focus.step_mm=1", "--step-files", "--out", "logo.dxf"];
    assert_eq!(desk.isomark(&[CAN, &["plain.dxf"], &steps].concat()).code, 0);
    let entries = std::fs::read_dir(desk.root()).unwrap().map(|entry| entry.unwrap().file_name());
    let names = entries.map(|name| name.into_string().unwrap());
    let step = names.into_iter().find(|name| name.starts_with("logo.z")).unwrap();
    desk.write(&step, &before);
    std::fs::remove_file(desk.path("logo.dxf")).unwrap();
    desk.isomark(&[CAN, &[&step], &steps].concat()).refused(2, &["which is also read"]);
    assert_eq!(desk.read(&step), before);
    assert!(!desk.path("logo.dxf").exists());
}

#[test]
fn a_report_does_not_overwrite_the_buffer_of_a_part() {
    let desk = Desk::new();
    for name in ["bl34-native.gltf", "bl34-native.bin"] {
        desk.write(name, std::fs::read(part(&format!("vessel/{name}"))).unwrap());
    }
    let before = desk.read("bl34-native.bin");
    desk.write("line.svg", "<svg xmlns='http://www.w3.org/2000/svg' width='2mm' height='2mm' viewBox='0 0 2 2'><path d='M0 1H2' fill='none' stroke='black'/></svg>");
    let inputs = ["correct", "bl34-native.gltf", "line.svg", "--place", "0,0", "--out", "out.dxf"];
    desk.isomark(&[&inputs[..], &["--report", "bl34-native.bin"]].concat())
        .refused(2, &["bl34-native.bin, which is also read"]);
    assert_eq!(desk.read("bl34-native.bin"), before);
    assert!(!desk.path("out.dxf").exists());
}

#[cfg(unix)]
#[test]
fn a_device_is_written_into_and_stays_one() {
    use std::os::unix::fs::symlink;

    let (desk, _) = desk("square.dxf");
    // A link: a program that replaces what is at the path would only replace the link.
    symlink("/dev/null", desk.path("nothing")).unwrap();
    for outputs in [&["--out", "nothing"][..], &["--out", "out.dxf", "--report", "nothing"]] {
        let output = desk.isomark(&[CAN, &["square.dxf"], outputs].concat());
        assert_eq!(output.code, 0, "{output:?}");
        assert!(desk.path("nothing").symlink_metadata().unwrap().is_symlink(), "{outputs:?}");
    }
    let pipe = desk.path("pipe");
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    let reader = std::thread::spawn(move || std::fs::read(pipe).unwrap());
    assert_eq!(desk.isomark(&[CAN, &["square.dxf", "--out", "pipe"]].concat()).code, 0);
    assert_eq!(desk.isomark(&[CAN, &["square.dxf", "--out", "out.dxf"]].concat()).code, 0);
    assert_eq!(reader.join().unwrap(), desk.read("out.dxf"));
    desk.isomark(&[CAN, &["square.dxf", "--out", "nothing", "--rotary"]].concat())
        .refused(2, &["beside nothing, which is a device"]);
}

/// Files in memory are files, although they are below `/dev`.
#[cfg(target_os = "linux")]
#[test]
fn a_file_in_memory_is_replaced_as_a_whole() {
    let Ok(folder) = tempfile::tempdir_in("/dev/shm") else { return };
    let (desk, _) = desk("square.dxf");
    let report = folder.path().join("report.json");
    std::fs::write(&report, "x".repeat(1_000_000)).unwrap();
    let outputs = ["square.dxf", "--out", "out.dxf", "--report", report.to_str().unwrap()];
    assert_eq!(desk.isomark(&[CAN, &outputs].concat()).code, 0);
    let report: serde_json::Value = serde_json::from_slice(&std::fs::read(&report).unwrap()).unwrap();
    assert_eq!(report["schema"], "isomark.report/1");
}
