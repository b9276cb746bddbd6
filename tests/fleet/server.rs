//! A PostgreSQL server of the system in a temporary folder, under its own user.

use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use fs_err as fs;

/// The password of the owner.
pub const SECRET: &str = "Hidden-7-Zebra";
/// The time limit for anything on a slow machine.
pub const DEADLINE: Duration = Duration::from_secs(60);

/// No run of the tests takes longer.
const LONGEST_RUN: Duration = Duration::from_secs(4 * 3600);

/// The folder with `initdb` and `postgres`; `None` if PostgreSQL is not installed, which is a failure in CI.
pub fn programs() -> Option<PathBuf> {
    let given = std::env::var_os("ISOMARK_POSTGRES").map(PathBuf::from);
    // Under Wine, this folder has programs that Wine does not run.
    let debian = cfg!(unix).then(|| fs::read_dir("/usr/lib/postgresql")).into_iter().flatten().flatten();
    let mut debian: Vec<PathBuf> = debian.filter_map(|entry| Some(entry.ok()?.path().join("bin"))).collect();
    debian.sort();
    debian.reverse();
    let path = std::env::var_os("PATH").unwrap_or_default();
    let all = given.into_iter().chain(debian).chain(std::env::split_paths(&path));
    let initdb = format!("initdb{}", std::env::consts::EXE_SUFFIX);
    let found = all.into_iter().find(|folder| folder.join(&initdb).exists());
    if found.is_none() {
        assert!(std::env::var_os("CI").is_none(), "PostgreSQL is needed in CI: apt-get install postgresql");
        println!("SKIPPED: PostgreSQL is not installed");
    }
    found
}

/// A command as the user of the server: PostgreSQL does not run as root.
#[cfg(unix)]
fn as_its_user(program: &Path) -> Command {
    use std::os::unix::process::CommandExt;
    let mut command = Command::new(program);
    if let Some((user, group)) = its_user() {
        command.uid(user).gid(group);
    }
    command.current_dir("/").stdin(Stdio::null());
    command
}

#[cfg(not(unix))]
fn as_its_user(program: &Path) -> Command {
    let mut command = Command::new(program);
    command.stdin(Stdio::null());
    command
}

/// User and group for the server, if the tests run as root.
#[cfg(unix)]
fn its_user() -> Option<(u32, u32)> {
    let id = |options: &[&str]| {
        let output = Command::new("id").args(options).output().unwrap();
        String::from_utf8_lossy(&output.stdout).trim().parse::<u32>().ok()
    };
    (id(&["-u"]) == Some(0))
        .then(|| (id(&["-u", "postgres"]).unwrap_or(65_534), id(&["-g", "postgres"]).unwrap_or(65_534)))
}

/// Gives a folder with its content to the user of the server.
#[cfg(unix)]
fn hand_over(folder: &Path) {
    if let Some((user, group)) = its_user() {
        let status = Command::new("chown").arg("-R").arg(format!("{user}:{group}")).arg(folder).status();
        assert!(status.unwrap().success());
    }
}

/// The server has no user of its own.
#[cfg(not(unix))]
fn hand_over(_: &Path) {}

/// A server. Dropping it ends it.
pub struct Server {
    programs: PathBuf,
    folder: tempfile::TempDir,
    pub port: u16,
}

impl Server {
    /// A running server with an empty database `isomark` of the owner; `None` if PostgreSQL is not installed.
    pub fn start() -> Option<Self> {
        let programs = programs()?;
        let folder = tempfile::Builder::new().prefix("isomark-postgres-").tempdir().unwrap();
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            fs::set_permissions(folder.path(), std::fs::Permissions::from_mode(0o755)).unwrap();
        }
        let server = Self { port: free_port(), programs, folder };
        server.make();
        server.set("listen_addresses = '127.0.0.1'\nunix_socket_directories = ''\nfsync = off\nmax_connections = 120\n");
        server.set(&format!("port = {}\n", server.port));
        server.run();
        server.sql("postgres", "CREATE DATABASE isomark");
        Some(server)
    }

    /// Makes the files of a server. `initdb` takes seconds, so its result is kept for the tests of one run.
    fn make(&self) {
        static ONCE: Mutex<()> = Mutex::new(());
        let _guard = ONCE.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        let kept = Path::new(env!("CARGO_TARGET_TMPDIR")).join("postgres-template");
        let of_run = kept.join(std::process::id().to_string());
        if !of_run.exists() {
            // Those of other runs that may still be going on stay.
            for run in fs::read_dir(&kept).into_iter().flatten().flatten() {
                let changed = run.metadata().and_then(|about| about.modified());
                if changed.is_ok_and(|at| at.elapsed().is_ok_and(|age| age > LONGEST_RUN)) {
                    let _ = fs::remove_dir_all(run.path());
                }
            }
            let made = self.folder.path().join("made");
            let password = self.folder.path().join("password");
            fs::write(&password, format!("{SECRET}\n")).unwrap();
            hand_over(self.folder.path());
            let output = as_its_user(&self.programs.join("initdb"))
                .args(["-U", "owner", "-A", "scram-sha-256", "-E", "UTF8", "--no-sync", "--locale=C"])
                .arg(format!("--pwfile={}", password.display()))
                .arg("-D")
                .arg(&made)
                .output()
                .unwrap();
            assert!(output.status.success(), "{output:?}");
            fs::create_dir_all(&kept).unwrap();
            copy(&made, &of_run);
        }
        copy(&of_run, &self.data());
        hand_over(self.folder.path());
    }

    fn data(&self) -> PathBuf {
        self.folder.path().join("data")
    }

    /// A file of the server's folder.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Adds lines to the settings of the server; they apply from the next start on.
    pub fn set(&self, lines: &str) {
        let file = self.data().join("postgresql.conf");
        let text = fs::read_to_string(&file).unwrap();
        fs::write(&file, text + lines).unwrap();
    }

    /// Gives the key of its certificate the rights that it asks for.
    #[cfg(unix)]
    pub fn secure_key(&self) {
        use std::os::unix::fs::PermissionsExt;
        let key = self.data().join("server.key");
        fs::set_permissions(key, std::fs::Permissions::from_mode(0o600)).unwrap();
        hand_over(self.folder.path());
    }

    /// Starts it, and waits until it answers.
    pub fn run(&self) {
        self.control(&["start", "-w", "-t", "60", "-l", &self.path("log").display().to_string()]);
    }

    /// Ends it as if the power was cut.
    pub fn cut(&self) {
        self.control(&["stop", "-m", "immediate", "-w"]);
    }

    fn control(&self, what: &[&str]) {
        let output = as_its_user(&self.programs.join("pg_ctl"))
            .args(what)
            .arg("-D")
            .arg(self.data())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .status()
            .unwrap();
        let log = fs::read_to_string(self.path("log")).unwrap_or_default();
        assert!(output.success(), "pg_ctl {what:?}: {log}");
    }

    /// The URL of the database for a login.
    pub fn url(&self, login: &str) -> String {
        format!("postgresql://{login}@127.0.0.1:{}/isomark", self.port)
    }

    /// Runs SQL as the owner, and gives the result as text.
    pub fn sql(&self, database: &str, text: &str) -> String {
        let output = self.sql_as("owner", SECRET, database, text);
        assert!(output.status.success(), "{text}: {}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap().trim().to_owned()
    }

    /// Runs SQL as a login.
    pub fn sql_as(&self, login: &str, password: &str, database: &str, text: &str) -> Output {
        self.psql(login, password, database, &["-c", text])
    }

    fn psql(&self, login: &str, password: &str, database: &str, what: &[&str]) -> Output {
        let port = self.port.to_string();
        let psql = self.programs.join("psql");
        let psql = if psql.exists() { psql } else { "psql".into() };
        Command::new(psql)
            .args([
                "-h",
                "127.0.0.1",
                "-p",
                &port,
                "-U",
                login,
                "-d",
                database,
                "-XAtq",
                "-v",
                "ON_ERROR_STOP=1",
            ])
            .args(what)
            .env("PGPASSWORD", password)
            .env("PGCONNECT_TIMEOUT", "30")
            .output()
            .unwrap()
    }

    /// A copy of the database, as the guide for plants makes it.
    pub fn dump(&self) -> PathBuf {
        let (file, port) = (self.path("dump.sql"), self.port.to_string());
        let program = self.programs.join("pg_dump");
        let output = Command::new(if program.exists() { program } else { "pg_dump".into() })
            .args(["-h", "127.0.0.1", "-p", &port, "-U", "owner", "isomark"])
            .env("PGPASSWORD", SECRET)
            .output()
            .unwrap();
        assert!(output.status.success(), "{output:?}");
        fs::write(&file, output.stdout).unwrap();
        file
    }

    /// Loses the database, whoever uses it, and makes it again: empty, or from a dump.
    pub fn lose(&self, dump: Option<&Path>) {
        self.sql("postgres", "DROP DATABASE isomark WITH (FORCE)");
        self.sql("postgres", "CREATE DATABASE isomark");
        if let Some(dump) = dump {
            let output = self.psql("owner", SECRET, "isomark", &["-f", &dump.display().to_string()]);
            assert!(output.status.success(), "{output:?}");
        }
    }

    /// Makes a login with a role; its password is that of the owner.
    pub fn login(&self, name: &str, role: &str) {
        self.sql("isomark", &format!("CREATE ROLE {name} LOGIN PASSWORD '{SECRET}' IN ROLE isomark_{role}"));
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = as_its_user(&self.programs.join("pg_ctl"))
            .args(["stop", "-m", "immediate", "-D"])
            .arg(self.data())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .status();
    }
}

fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        fs::set_permissions(to, std::fs::Permissions::from_mode(0o700)).unwrap();
    }
    for entry in fs::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        let target = to.join(path.file_name().unwrap());
        if path.is_dir() {
            copy(&path, &target)
        } else {
            let _ = fs::copy(&path, &target).unwrap();
        }
    }
}

pub fn free_port() -> u16 {
    TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port()
}

/// Waits until something is true.
#[track_caller]
pub fn waits_for(what: &str, mut condition: impl FnMut() -> bool, state: impl Fn() -> String) {
    let started = Instant::now();
    while !condition() {
        assert!(started.elapsed() < DEADLINE, "{what}; {}", state());
        std::thread::sleep(Duration::from_millis(20));
    }
}
