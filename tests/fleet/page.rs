//! The fleet on the page of a station.

use std::io::{Read, Write};
use std::net::TcpStream;
#[cfg(unix)]
use std::process::Command;

#[cfg(unix)]
use crate::browser;
#[cfg(unix)]
use crate::server::{Server, waits_for};
use crate::station::Station;
#[cfg(unix)]
use crate::station::{in_fleet, line, trough};
use crate::tables::server_with_tables;

/// The address of the page of a station.
fn address(station: &Station) -> String {
    let start = "the page of the station is at http://";
    station.waits_for("the page", |station| station.log().contains(start));
    station.log().split(start).nth(1).unwrap().split(['/', ' ', '\n']).next().unwrap().to_owned()
}

fn page(address: &str) -> String {
    let mut stream = TcpStream::connect(address).unwrap();
    write!(stream, "GET / HTTP/1.1\r\nHost: {address}\r\n\r\n").unwrap();
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).unwrap();
    String::from_utf8_lossy(&answer).into_owned()
}

/// A station with its page, beside one that delivered a drawing and was stopped.
#[cfg(unix)]
fn two_stations(server: &Server) -> (Station, String) {
    for name in ["laser1", "laser2"] {
        server.login(name, "station");
    }
    let mut other = Station::of("laser2", &server.url("laser2"));
    other.waits_for_fleet(1);
    other.drop_in("trough.obj", &trough(1.0));
    other.drop_in("trough.dxf", &line(9.0));
    other.waits_for_file("import/trough.dxf");
    other.waits_for("its status", |other| other.status()["done"]["delivered"] == 1);
    other.stop();
    let settings = format!("[page]\naddress = \"127.0.0.1:0\"\n{}", in_fleet(&server.url("laser1")));
    let mut station = Station::new("laser1", &settings);
    station.start();
    station.waits_for_fleet(1);
    let address = address(&station);
    (station, address)
}

#[cfg(unix)]
#[test]
fn the_page_of_a_station_shows_the_fleet() {
    let Some((server, _desk)) = server_with_tables() else { return };
    let (station, address) = two_stations(&server);
    let shows = |words: &[&str]| {
        let shown = || {
            let page = page(&address);
            words.iter().all(|word| page.contains(word))
        };
        waits_for(&format!("{words:?}"), shown, || page(&address));
    };
    let row = "<th scope=\"row\">laser2</th><td><span class=\"chip \">Stopped</span></td><td>0</td><td>1</td><td>1</td><td>0</td>";
    shows(&[
        row,
        ">Available<",
        "2 stations",
        "<th scope=\"row\">laser1</th><td><span class=\"chip good\">Alive</span>",
    ]);
    let seen = station.status()["fleet"].clone();
    assert_eq!(
        (&seen["name"], &seen["available"], &seen["count"]),
        (&"laser1".into(), &true.into(), &2.into())
    );
    // Without the database, the page shows what was seen last.
    server.cut();
    shows(&[">Not available<", row]);
    server.run();
    shows(&[">Available<", row]);
    if let Some(axe) = browser::axe() {
        let mut command = Command::new("python3");
        command.args(["-B", "tests/browser/fleet.py"]).arg(axe).arg(format!("http://{address}/"));
        command.args(std::env::var_os("ISOMARK_SCREENSHOTS"));
        let output = command.output().unwrap();
        let text = String::from_utf8_lossy(&output.stdout);
        assert!(output.status.success(), "{text}{}", String::from_utf8_lossy(&output.stderr));
    }
}

#[test]
fn a_station_without_a_fleet_or_a_page_reads_no_other_stations() {
    let Some((server, _desk)) = server_with_tables() else { return };
    server.login("laser1", "station");
    let station = Station::of("laser1", &server.url("laser1"));
    station.waits_for_fleet(1);
    station.waits_for("a status", |station| station.status()["running"] == true);
    assert!(station.status().get("fleet").is_none());
    let mut alone = Station::new("laser2", "[page]\naddress = \"127.0.0.1:0\"\n");
    alone.start();
    let page = page(&address(&alone));
    assert!(page.contains("<div id=\"p-fleet\"></div>"), "{page}");
}
