//! A station's part in its fleet: one thread that connects to the database, and again whenever the connection ends.

mod parts;

use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::mem::{Discriminant, discriminant};
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::runtime::Builder;
use tokio::sync::mpsc::{UnboundedReceiver, UnboundedSender, unbounded_channel};
use tokio::time::{Instant, timeout, timeout_at};
use tokio_postgres::types::Type;

use super::address::Address;
use super::asking::{After, Asking, News, Step, Wish};
use super::desk::{Contact, Desk, Earlier};
use super::error::{FleetError, Needed};
use super::fits::{self, Fetched};
use super::incoming::{self, Incoming};
use super::jobs;
use super::migrations;
use super::office;
use super::outbox::{Entry, Outbox};
use super::session::{Heard, Session};
use super::sku_files::SkuFiles;
use super::workers;
use crate::cache::{Cache, CacheKey, CurrentPart, PartOrigin, SharedSurfaces};
use crate::config::{FleetSettings, FolderPaths, Sku, Station};
use crate::hotfolder::line::{Answer, Claim, JobNews, LineJob, Lines, Offered, OurJobs, Wake};
use crate::hotfolder::{Figures, Fleet, FleetSeen, timestamp_now};
use crate::printable::on_one_line;
use crate::reason::Reason;

/// The time between two signs of life, unless the figures change.
const BEAT: Duration = Duration::from_secs(10);
/// The shortest time between two signs of life.
const SHORTEST_BEAT: Duration = Duration::from_secs(5);
/// The first pause after a failed connection; it doubles up to [`LONGEST_PAUSE`].
const FIRST_PAUSE: Duration = Duration::from_secs(1);
const LONGEST_PAUSE: Duration = Duration::from_secs(30);
/// How long a station that ends waits for its farewell.
const FAREWELL: Duration = Duration::from_secs(2);
/// How long the end of a station waits for the thread.
const LONGEST_END: Duration = Duration::from_secs(3);
/// The longest trouble that is shared, characters.
const LONGEST_TROUBLE: usize = 1000;

/// The outbox in the state folder.
const OUTBOX: &str = "fleet/outbox";
/// How long the job of a dropped part waits for a fit of the fleet.
const FETCH: Duration = Duration::from_secs(1);
/// A database that takes longer for a sign of life is too slow to wait for its fits.
const SLOW: Duration = Duration::from_millis(250);
/// How long a drop waits for the queue of another line.
const OFFER: Duration = Duration::from_secs(2);
/// Fits that the fleet did not have and that are wished for; more are not remembered.
const WISHES: usize = 10_000;
/// What asks the stations for a surface that the fleet does not have: its key, the hash of its part, and the SKU.
const WANTED: &str = "wanted";
/// The channel of the database on which changes are announced.
const LISTEN: &str = "LISTEN isomark";

/// A station's part in its fleet.
pub struct Member {
    settings: FleetSettings,
    /// One run of the program: two stations with one name notice each other by it.
    process: String,
    orders: UnboundedSender<Order>,
    received: Mutex<Option<UnboundedReceiver<Order>>>,
    shared: Mutex<Shared>,
    /// Held while a part becomes the current one, so that none of the fleet replaces one that is to be announced.
    outbox: Mutex<Outbox>,
    /// The files with the settings of SKUs.
    files: Arc<SkuFiles>,
    /// Whether the stations of the fleet are read for the status.
    shows_fleet: bool,
    /// Jobs for other lines.
    desk: Desk,
    /// Fits that workers make.
    asking: Asking,
}

/// What the thread of the fleet and the rest of the station share.
#[derive(Default)]
struct Shared {
    figures: Option<Figures>,
    /// Why the fleet is away.
    trouble: Option<(Discriminant<FleetError>, String)>,
    /// Why the fleet is there and something is wrong nevertheless.
    complaint: Option<String>,
    /// The last fit of the fleet that could not be used.
    wrong: Option<String>,
    /// SKUs whose part or surface arrived.
    news: BTreeSet<Sku>,
    /// Whether the database answers.
    answers: bool,
    /// Whether the last sign of life or fetch took long.
    is_slow: bool,
    cache: PathBuf,
    /// The settings of the station changed: a release that could not be used may be valid now.
    has_other_settings: bool,
    /// The fleet, as it was read last.
    seen: FleetSeen,
    /// Fits that were asked for without waiting, until they arrive.
    wishes: BTreeMap<CacheKey, Wish>,
}

/// What the thread of the fleet wakes up for.
enum Order {
    Heard(Heard),
    /// The outbox has something to send.
    Send,
    /// A fit is needed; the answer is whether the cache has it now.
    Fetch(Wish, CacheKey, Option<SyncSender<bool>>),
    /// A job needs a fit from a worker.
    Ask(CacheKey, Step),
    /// A drop is for another line.
    Offer(Arc<LineJob>, SyncSender<Offered>),
    /// The station has other jobs than before.
    Jobs,
    End,
}

/// The thread of a member. Dropping it ends the thread, and waits for that for a moment.
pub struct Running {
    orders: UnboundedSender<Order>,
    ended: Receiver<()>,
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.orders.send(Order::End);
        // Connecting to a server that does not answer takes longer.
        let _ = self.ended.recv_timeout(LONGEST_END);
    }
}

impl Member {
    /// The part of a station with these settings and folders; nothing is read or connected yet.
    #[must_use]
    pub fn new(settings: FleetSettings, folders: &FolderPaths, files: Arc<SkuFiles>) -> Self {
        let (orders, received) = unbounded_channel();
        let process = super::process();
        let outbox = Mutex::new(Outbox::new(&folders.state.join(OUTBOX)));
        let seen = FleetSeen { name: settings.name.clone(), ..FleetSeen::default() };
        let shared = Mutex::new(Shared { cache: folders.cache.clone(), seen, ..Shared::default() });
        Self {
            settings,
            process,
            orders,
            received: Mutex::new(Some(received)),
            shared,
            outbox,
            files,
            shows_fleet: false,
            desk: Desk::default(),
            asking: Asking::default(),
        }
    }

    /// The same, which also reads the other stations for the status.
    #[must_use]
    pub fn showing_fleet(self) -> Self {
        Self { shows_fleet: true, ..self }
    }

    /// Starts the thread, once the station holds its lock. It takes part in the fleet until [`Running`] is dropped. Without a
    /// thread, the station works alone.
    pub fn start(self: &Arc<Self>) -> Option<Running> {
        let received = self.received.lock().unwrap_or_else(PoisonError::into_inner).take()?;
        let (ending, ended) = sync_channel(1);
        let member = self.clone();
        let started = std::thread::Builder::new().name("fleet".into()).spawn(move || {
            member.run(received);
            let _ = ending.send(());
        });
        match started {
            Ok(_) => Some(Running { orders: self.orders.clone(), ended }),
            Err(error) => {
                self.is_away(&FleetError::Away(error.to_string()));
                None
            }
        }
    }

    fn shared(&self) -> MutexGuard<'_, Shared> {
        self.shared.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn outbox(&self) -> MutexGuard<'_, Outbox> {
        self.outbox.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn cache(&self) -> Cache {
        Cache::new(&self.shared().cache)
    }

    fn run(&self, mut received: UnboundedReceiver<Order>) {
        match Builder::new_current_thread().enable_io().enable_time().max_blocking_threads(1).build() {
            Ok(runtime) => {
                runtime.block_on(self.take_part(&mut received));
                // The look-up of a name may take long.
                runtime.shutdown_background();
            }
            Err(error) => self.is_away(&FleetError::Away(error.to_string())),
        }
    }

    async fn take_part(&self, orders: &mut UnboundedReceiver<Order>) {
        self.files.tidy();
        let mut pause = FIRST_PAUSE;
        loop {
            let error = match self.connected(orders, &mut pause).await {
                Ok(()) => return,
                Err(error) => error.needing(Needed::Station),
            };
            self.is_away(&error);
            let again = Instant::now() + pause;
            pause = (pause * 2).min(LONGEST_PAUSE);
            while let Ok(order) = timeout_at(again, orders.recv()).await {
                if matches!(order, Some(Order::End) | None) {
                    return;
                }
            }
        }
    }

    /// One connection; ends without an error when the station ends.
    async fn connected(
        &self,
        orders: &mut UnboundedReceiver<Order>,
        pause: &mut Duration,
    ) -> Result<(), FleetError> {
        let address = Address::of(&self.settings)?;
        let session = Session::open(&address, Some((self.orders.clone(), Order::Heard))).await?;
        migrations::check(&session).await?;
        // Before the parts are read: no change is missed.
        session.batch(LISTEN).await?;
        // Before the sign of life: what earlier connections stated about jobs may have changed.
        self.desk.begin();
        self.beat(&session, &self.figures(), true, false).await?;
        self.asking.leave_all(&session, &self.settings.name).await?;
        self.send_announcements(&session).await?;
        let mut lost = self.read_all_parts(&session).await?;
        self.look_at_fleet(&session).await?;
        jobs::serve(&session, &self.settings).await?;
        *pause = FIRST_PAUSE;
        self.is_there(&address);
        self.desk.note(JobNews::Available);
        let mut last = (Instant::now(), self.figures());
        let mut releases = Incoming::new();
        loop {
            let (figures, now) = (self.figures(), Instant::now());
            if now >= last.0 + BEAT || (last.1 != figures && now >= last.0 + SHORTEST_BEAT) {
                self.beat(&session, &figures, true, true).await?;
                self.look_at_fleet(&session).await?;
                last = (Instant::now(), figures);
                // A job may be free without a word: the server ended the connection of its taker.
                self.desk.look_again();
            }
            let has_more = jobs::work(&session, &self.settings, &self.desk).await?;
            // Other work comes between two entries of the outbox.
            let first = self.outbox().first().map_err(|error| FleetError::Outbox(error.to_string()))?;
            self.report_settings(&session, &mut releases).await?;
            let has_work = first.is_some() || releases.has_work() || has_more || !lost.is_empty();
            let patience = if has_work { Duration::ZERO } else { SHORTEST_BEAT };
            match timeout(patience, orders.recv()).await {
                Err(_) => {
                    if releases.has_work() {
                        let changed = releases.step(&session, &self.settings.name, &self.files).await?;
                        self.shared().news.extend(changed);
                    }
                    // Announcements before surfaces.
                    if let Some(sku) = lost.pop_front() {
                        self.announce_again(&session, &sku).await?;
                    } else if let Some((number, entry)) = first {
                        self.send(&session, number, &entry).await?;
                    }
                }
                Ok(Some(Order::Send | Order::Jobs)) => {}
                Ok(Some(Order::Offer(job, answer))) => self.offer_now(&session, &job, &answer).await?,
                Ok(Some(Order::Fetch(wish, key, answer))) => {
                    let _ = self.fetch_now(&session, &wish, &key, answer.as_ref()).await?;
                }
                Ok(Some(Order::Ask(key, step))) => self.ask_now(&session, &key, step).await?,
                Ok(Some(Order::Heard(Heard::Notified(text)))) => match text.strip_prefix("settings ") {
                    Some(sku) => releases.ask(sku),
                    None => self.hear(&session, &text).await?,
                },
                Ok(Some(Order::Heard(Heard::Closed(error)))) => return Err(error),
                Ok(Some(Order::End) | None) => {
                    // The last word is a courtesy: without it the station becomes silent.
                    let _ = timeout(FAREWELL, self.beat(&session, &self.figures(), false, true)).await;
                    return Ok(());
                }
            }
        }
    }

    /// Reports what was found in the files of SKUs outside this thread.
    async fn report_settings(&self, session: &Session, releases: &mut Incoming) -> Result<(), FleetError> {
        let reports = self.files.take_reports();
        let reports = reports.into_iter().map(|(sku, report)| (sku.key().to_owned(), report)).collect();
        incoming::send(session, &self.settings.name, reports).await?;
        if std::mem::take(&mut self.shared().has_other_settings) {
            releases.ask_for_all();
        }
        Ok(())
    }

    /// Puts a surface into the outbox.
    fn share(&self, sku: &Sku, key: &CacheKey, part: &PartOrigin) {
        let entry = Entry::Fit { sku: sku.as_str().into(), key: key.clone(), part: part.clone() };
        // Every station can make it again.
        if let Err(error) = self.outbox().add(entry) {
            tracing::warn!("the surface of {sku} cannot be shared: {error}");
        }
    }

    fn figures(&self) -> Figures {
        self.shared().figures.clone().unwrap_or_default()
    }

    /// Handles what the database announces.
    async fn hear(&self, session: &Session, text: &str) -> Result<(), FleetError> {
        match text.split_once(' ') {
            Some(("part", sku)) => match fits::current(session, sku).await? {
                Some(theirs) => self.hear_of_part(session, theirs).await,
                None => Ok(()),
            },
            Some(("fit", key)) => {
                let wished = self
                    .shared()
                    .wishes
                    .iter()
                    .find(|(known, _)| known.as_str() == key)
                    .map(|(known, wish)| (known.clone(), wish.clone()));
                match wished {
                    Some((key, wish)) => self.fetch_now(session, &wish, &key, None).await.map(drop),
                    None => Ok(()),
                }
            }
            Some((WANTED, what)) => {
                self.share_what_is_wanted(what);
                Ok(())
            }
            Some(("request", key)) => match self.asking.own(key) {
                Some(key) => self.ask_now(session, &key, Step::Look).await,
                None => Ok(()),
            },
            Some(("job", line)) => {
                if line == self.settings.name || self.settings.lines.iter().any(|of_it| of_it == line) {
                    self.desk.look();
                }
                Ok(())
            }
            _ => Ok(()),
        }
    }

    /// Sends a job to its line, and answers.
    async fn offer_now(
        &self,
        session: &Session,
        job: &LineJob,
        answer: &SyncSender<Offered>,
    ) -> Result<(), FleetError> {
        let offered = match jobs::offer(session, Some(&self.settings.name), job).await {
            Ok((_, offered)) => offered,
            Err(error) if error.is_final() => Offered::Refused(error.reason()),
            Err(error) => return Err(error),
        };
        self.desk.end_offer(&job.id, offered, answer);
        Ok(())
    }

    /// Does a step of asking a worker for a fit.
    async fn ask_now(&self, session: &Session, key: &CacheKey, step: Step) -> Result<(), FleetError> {
        let after = match self.asking.step(session, &self.settings.name, key, step).await {
            // The job makes the fit itself.
            Err(error) if error.is_final() => {
                tracing::warn!("a fit cannot be requested: {error}");
                self.asking.tell(key, News::Over);
                return Ok(());
            }
            after => after?,
        };
        if let After::Fetch(wish) = after {
            let is_kept = self.fetch_now(session, &wish, key, None).await?;
            self.asking.tell(key, if is_kept { News::Kept } else { News::Over });
        }
        Ok(())
    }

    /// Fetches a fit into the cache, and answers. Whether the cache has it now.
    async fn fetch_now(
        &self,
        session: &Session,
        wish: &Wish,
        key: &CacheKey,
        answer: Option<&SyncSender<bool>>,
    ) -> Result<bool, FleetError> {
        let Wish { cache, sku, part } = wish;
        let started = Instant::now();
        let fetched = fits::fetch(session, cache, sku, key, part).await?;
        if let Some(answer) = answer {
            let _ = answer.try_send(fetched == Fetched::Kept);
        }
        {
            let mut shared = self.shared();
            shared.is_slow = started.elapsed() > FETCH;
            if fetched == Fetched::Kept && shared.wishes.remove(key).is_some() {
                shared.news.insert(sku.clone());
            }
            if let Fetched::Wrong(what) = &fetched {
                let text = format!(
                    "the fit {} of {sku} in the fleet is not used: {what}. `isomark fleet prune URL --fit {}` removes it",
                    key.as_str(),
                    key.as_str()
                );
                if shared.wrong.as_ref() != Some(&text) {
                    tracing::warn!("{text}");
                }
                shared.wrong = Some(text);
            }
        }
        let is_kept = fetched == Fetched::Kept;
        if is_kept {
            fits::note_use(session, key).await?;
        } else if fetched == Fetched::Absent && answer.is_none() {
            // Its drawings wait. Another station may have it.
            let text = format!("{WANTED} {} {} {}", key.as_str(), part.blake3, sku.key());
            session.rows("SELECT pg_notify('isomark', $1)", &[(&text, Type::TEXT)]).await?;
        }
        Ok(is_kept)
    }

    /// Gives a sign of life.
    async fn beat(
        &self,
        session: &Session,
        figures: &Figures,
        runs: bool,
        has_beaten: bool,
    ) -> Result<(), FleetError> {
        let count = |number: u64| i64::try_from(number).unwrap_or(i64::MAX);
        let trouble: Option<String> =
            figures.trouble.as_ref().map(|text| on_one_line(text).chars().take(LONGEST_TROUBLE).collect());
        let program = super::program();
        let (started, contact) = (Instant::now(), Contact::now());
        let row = session
            .row(
                "SELECT isomark.beat($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11)",
                &[
                    (&self.settings.name, Type::TEXT),
                    (&self.process, Type::TEXT),
                    (&program, Type::TEXT),
                    (&runs, Type::BOOL),
                    (&count(figures.waiting), Type::INT8),
                    (&count(figures.delivered), Type::INT8),
                    (&count(figures.learned), Type::INT8),
                    (&count(figures.rejected), Type::INT8),
                    (&count(figures.outdated), Type::INT8),
                    (&count(figures.uncertain), Type::INT8),
                    (&trouble, Type::TEXT),
                ],
            )
            .await?;
        self.desk.has_contact(contact);
        let before: String = row.try_get(0)?;
        let complaint = (has_beaten && before != self.process).then(|| {
            format!(
                "Another running station also uses the name \"{}\" in the fleet. Give one of them another `name` under [fleet].",
                on_one_line(&self.settings.name)
            )
        });
        let mut shared = self.shared();
        shared.is_slow = started.elapsed() > SLOW;
        if let Some(text) = &complaint
            && shared.complaint.is_none()
        {
            tracing::warn!("{text}");
        }
        shared.complaint = complaint;
        Ok(())
    }

    /// Reads the stations of the fleet, if the status shows them.
    async fn look_at_fleet(&self, session: &Session) -> Result<(), FleetError> {
        if !self.shows_fleet {
            return Ok(());
        }
        let (count, stations) = office::stations_for_page(session).await?;
        let workers = workers::listed(session).await?;
        let mut shared = self.shared();
        shared.seen =
            FleetSeen { count, stations, workers, at: Some(timestamp_now()), ..shared.seen.clone() };
        Ok(())
    }

    /// Reports once why the fleet is away.
    fn is_away(&self, error: &FleetError) {
        let text = format!("{} The station works without the fleet.", error.reason().on_one_line());
        let mut shared = self.shared();
        let kind = discriminant(error);
        if shared.trouble.as_ref().is_none_or(|(last, _)| *last != kind) {
            tracing::warn!("{text}");
        }
        shared.trouble = Some((kind, text));
        shared.answers = false;
        shared.complaint = None;
        drop(shared);
        self.asking.give_up();
    }

    fn is_there(&self, address: &Address) {
        let was_away = {
            let mut shared = self.shared();
            shared.answers = true;
            // The fleet may have the fits now that it did not have.
            for (key, wish) in &shared.wishes {
                let _ = self.orders.send(Order::Fetch(wish.clone(), key.clone(), None));
            }
            shared.trouble.take().is_some()
        };
        let again = if was_away { " again" } else { "" };
        let name = on_one_line(&self.settings.name);
        tracing::info!("the fleet at {address} is available{again}; this station is {name} there");
    }
}

impl Lines for Member {
    fn own_name(&self) -> &str {
        &self.settings.name
    }

    fn cannot_offer(&self) -> Option<Reason> {
        (!self.shared().answers).then(no_answer)
    }

    fn offer(&self, job: &Arc<LineJob>) -> Offered {
        match self.desk.begin_offer(&job.id) {
            Earlier::Answered(answer) => return answer,
            Earlier::IsBeingSent => return Offered::NotNow(no_answer()),
            Earlier::None => {}
        }
        let (answer, answered) = sync_channel(1);
        let is_sent = self.orders.send(Order::Offer(job.clone(), answer)).is_ok();
        match if is_sent { answered.recv_timeout(OFFER) } else { Err(RecvTimeoutError::Disconnected) } {
            Ok(answer) => {
                self.desk.forget_offer(&job.id);
                answer
            }
            // It may be sent meanwhile; then the next attempt finds the answer.
            Err(RecvTimeoutError::Timeout) => Offered::NotNow(no_answer()),
            Err(RecvTimeoutError::Disconnected) => {
                self.desk.forget_offer(&job.id);
                Offered::NotNow(no_answer())
            }
        }
    }

    fn wake_with(&self, wake: Wake) {
        self.desk.wake_with(wake);
    }

    fn exchange(&self, ours: OurJobs) -> Vec<JobNews> {
        let (news, is_new) = self.desk.exchange(ours);
        if is_new {
            let _ = self.orders.send(Order::Jobs);
        }
        news
    }

    fn answer(&self, claim: &Claim, answer: Answer) {
        self.desk.answer(claim, answer);
    }

    fn is_confirmed(&self, claim: &Claim) -> bool {
        self.desk.is_confirmed(claim, Contact::now())
    }
}

/// Why no job can be sent now; the status shows what is wrong with the fleet.
fn no_answer() -> Reason {
    let what = "The fleet's database does not answer.";
    Reason::new(
        "line-away",
        what,
        "Wait: it continues automatically. `isomark status` shows what is wrong with the fleet.",
    )
}

impl Fleet for Member {
    fn publish(&self, figures: Figures) {
        self.shared().figures = Some(figures);
    }

    fn take_news(&self) -> Vec<Sku> {
        std::mem::take(&mut self.shared().news).into_iter().collect()
    }

    fn follow(&self, station: &Station) {
        self.files.follow(station);
        let mut shared = self.shared();
        shared.cache = station.folders.cache.clone();
        shared.has_other_settings = true;
    }

    fn trouble(&self) -> Option<String> {
        let shared = self.shared();
        let away = shared.trouble.as_ref().map(|(_, text)| text.clone());
        away.or_else(|| shared.complaint.clone()).or_else(|| shared.wrong.clone())
    }

    fn notices(&self) -> Vec<String> {
        self.files.notices()
    }

    fn seen(&self) -> Option<FleetSeen> {
        let shared = self.shared();
        let trouble = shared.trouble.as_ref().map(|(_, text)| text.clone());
        let seen = FleetSeen { available: shared.answers, trouble, ..shared.seen.clone() };
        self.shows_fleet.then_some(seen)
    }
}

impl SharedSurfaces for Member {
    fn fetch(&self, cache: &Cache, sku: &Sku, key: &CacheKey, part: &PartOrigin) -> bool {
        {
            let shared = self.shared();
            if !shared.answers || shared.is_slow {
                return false;
            }
        }
        let (answer, answered) = sync_channel(1);
        let wish = Wish { cache: cache.clone(), sku: sku.clone(), part: part.clone() };
        if self.orders.send(Order::Fetch(wish, key.clone(), Some(answer))).is_err() {
            return false;
        }
        match answered.recv_timeout(FETCH) {
            Ok(is_kept) => is_kept,
            // The next ones do not wait until the database has answered again.
            Err(RecvTimeoutError::Timeout) => {
                self.shared().is_slow = true;
                false
            }
            Err(RecvTimeoutError::Disconnected) => false,
        }
    }

    fn wish(&self, cache: &Cache, sku: &Sku, key: &CacheKey, part: &PartOrigin) {
        let wish = Wish { cache: cache.clone(), sku: sku.clone(), part: part.clone() };
        {
            let mut shared = self.shared();
            if shared.wishes.len() >= WISHES || shared.wishes.insert(key.clone(), wish.clone()).is_some() {
                return;
            }
            if !shared.answers {
                return;
            }
        }
        let _ = self.orders.send(Order::Fetch(wish, key.clone(), None));
    }

    fn have_made(
        &self,
        cache: &Cache,
        sku: &Sku,
        key: &CacheKey,
        part: &PartOrigin,
        task: &dyn Fn() -> Option<Vec<u8>>,
    ) -> bool {
        let may_ask = || {
            let shared = self.shared();
            self.settings.workers && shared.answers && !shared.is_slow
        };
        if !may_ask() {
            return false;
        }
        let Some(task) = task() else { return false };
        let wish = Wish { cache: cache.clone(), sku: sku.clone(), part: part.clone() };
        let order = |step| self.orders.send(Order::Ask(key.clone(), step)).is_ok();
        let is_made = self.asking.wait(wish, key, task, order);
        if is_made {
            tracing::info!("a worker of the fleet fitted the part of {sku}");
        }
        is_made
    }

    fn offer(&self, sku: &Sku, key: &CacheKey, part: &PartOrigin) {
        self.share(sku, key, part);
        let _ = self.orders.send(Order::Send);
    }

    fn make_current(&self, cache: &Cache, sku: &Sku, part: &CurrentPart) -> io::Result<()> {
        {
            // A part of the fleet takes its place before or after both steps.
            let mut outbox = self.outbox();
            outbox.add(Entry::learned(sku, part))?;
            cache.make_current(sku, part)?;
        }
        let _ = self.orders.send(Order::Send);
        Ok(())
    }
}
