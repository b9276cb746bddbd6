//! Encrypted connections: the server is verified, and nothing falls back to a plain connection.

use std::process::Command;

use fs_err as fs;

use crate::desk::Desk;
use crate::server::{Server, programs};
use crate::tables::fleet;

/// Makes an authority, and a certificate that it signed for `names`, in the folder.
fn certificates(desk: &Desk, authority: &str, names: &str) {
    let openssl = |arguments: &[&str]| {
        let output = Command::new("openssl").args(arguments).current_dir(desk.root()).output().unwrap();
        assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    };
    let key = ["-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes"];
    let (ca, ca_key) = (format!("{authority}.pem"), format!("{authority}.key"));
    let of_authority = ["req", "-x509", "-days", "2", "-subj", "/CN=plant", "-keyout", &ca_key, "-out", &ca];
    openssl(&[&of_authority[..], &key].concat());
    openssl(
        &[&["req", "-subj", "/CN=server", "-keyout", "server.key", "-out", "server.csr"], &key[..]].concat(),
    );
    desk.write("extensions", format!("subjectAltName={names}\nbasicConstraints=CA:FALSE\n"));
    openssl(&[
        "x509",
        "-req",
        "-in",
        "server.csr",
        "-CA",
        &ca,
        "-CAkey",
        &ca_key,
        "-CAcreateserial",
        "-days",
        "2",
        "-extfile",
        "extensions",
        "-out",
        "server.pem",
    ]);
}

#[test]
fn the_server_is_verified_and_nothing_falls_back_to_a_plain_connection() {
    if programs().is_none() {
        return;
    }
    if Command::new("openssl").arg("version").output().is_err() {
        assert!(std::env::var_os("CI").is_none(), "openssl is needed in CI");
        println!("SKIPPED: openssl is not installed");
        return;
    }
    let Some(server) = Server::start() else { return };
    let desk = Desk::new();
    let url = server.url("owner") + "?sslmode=verify-full";
    fleet(&desk, &["init", &url, "--certificate", "absent.pem"]).refused(2, &["absent.pem"]);
    certificates(&desk, "plant", "IP:127.0.0.1");
    // The server has no certificate yet.
    fleet(&desk, &["init", &url, "--certificate", "plant.pem"])
        .refused(3, &["TLS", "Set up TLS on the server", "sslmode=disable"]);
    let set_up = |names: &str| {
        certificates(&desk, "plant", names);
        for file in ["server.key", "server.pem"] {
            fs::copy(desk.path(file), server.path("data").join(file)).unwrap();
        }
        server.secure_key();
        server.cut();
        server.run();
    };
    server.set("ssl = on\nssl_cert_file = 'server.pem'\nssl_key_file = 'server.key'\n");
    set_up("IP:127.0.0.1");
    let made = fleet(&desk, &["init", &url, "--certificate", "plant.pem"]);
    assert_eq!(made.code, 0, "{}", made.err);
    let check = fleet(&desk, &["check", &url, "--certificate", "plant.pem"]);
    assert!(check.out.contains("encrypted, server verified"), "{check:?}");
    let ciphers = "SELECT count(*) FROM pg_stat_ssl WHERE ssl AND version >= 'TLSv1.2'";
    assert_eq!(server.sql("isomark", ciphers), "1", "psql itself is encrypted, so the server is");
    // The system does not trust this authority.
    let refused = |options: &[&str], words: &[&str]| {
        let output = fleet(&desk, &[&["status", &url], options].concat());
        output.refused(3, &[words, &["Name the authority", "--certificate"]].concat());
        assert!(!output.err.contains("sslmode=disable"), "{output:?}");
    };
    refused(&[], &["UnknownIssuer"]);
    // The certificate is for another server.
    set_up("IP:127.0.0.2,DNS:localhost");
    refused(&["--certificate", "plant.pem"], &["not valid for name"]);
    // Another authority signed for the right name.
    certificates(&desk, "stranger", "IP:127.0.0.1");
    set_up("IP:127.0.0.1");
    refused(&["--certificate", "stranger.pem"], &["certificate"]);
}
