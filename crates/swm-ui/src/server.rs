//! Routes, limits and the life of the server.

use std::net::{IpAddr, SocketAddr, TcpListener, ToSocketAddrs as _};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use axum::Router;
use axum::extract::{ConnectInfo, DefaultBodyLimit, Request, State};
use axum::http::{StatusCode, header};
use axum::middleware::{self, Next};
use axum::response::{IntoResponse as _, Response};
use axum::routing::{get, post};
use swm_core::{Cancel, Registry};

use crate::commands::Commands;
use crate::connections::{Caller, Door};
use crate::data::Store;
use crate::error::{Refusal, UiError};
use crate::guard::{Guard, Pass};
use crate::requests::Requests;
use crate::roots::Roots;
use crate::{assets, data, play, requests, results};

/// What is served, and where.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Options {
    /// Environments, policies, solvers and dataset formats.
    pub registry: Registry,
    /// What the command line does for the page. `None`: no manifests are made, and neither jobs nor oracles are shown.
    pub commands: Option<Arc<dyn Commands>>,
    /// What may be looked at: datasets, folders of results, training runs, or folders that hold them.
    pub paths: Vec<PathBuf>,
    /// The only folder that is written to: recordings, manifests, and results of requests. `None`: nothing is written.
    pub save: Option<PathBuf>,
    /// The name or address by which browsers reach the server.
    pub host: String,
    /// The port; 0: a free one.
    pub port: u16,
    /// Without a request and an open connection for so long, the server ends. `None`: never.
    pub idle: Option<Duration>,
    /// Environments that are open at once.
    pub max_sessions: usize,
    /// The origin of a page that may show this one in a frame: `http://localhost:8888`, a notebook. `None`: none may.
    pub frame_from: Option<String>,
}

impl Options {
    /// This machine only, a free port, nothing written, two hours, four environments.
    pub fn new(registry: Registry) -> Self {
        Self {
            registry,
            commands: None,
            paths: Vec::new(),
            save: None,
            host: "127.0.0.1".to_owned(),
            port: 0,
            idle: Some(Duration::from_secs(2 * 3600)),
            max_sessions: 4,
            frame_from: None,
        }
    }
}

/// Bytes of a request's body and of a message from the page: settings and factors are far smaller.
pub(crate) const MAX_MESSAGE_BYTES: usize = 256 << 10;
/// How long environments that are being recorded have to commit what they hold when the server ends.
pub const SAVING: Duration = Duration::from_secs(30);

/// What every request sees.
pub(crate) struct App {
    pub registry: Registry,
    commands: Option<Arc<dyn Commands>>,
    pub roots: Roots,
    pub store: Store,
    pub requests: Requests,
    guard: Guard,
    max_sessions: usize,
    sessions: AtomicUsize,
    threads: Mutex<Vec<JoinHandle<()>>>,
    seen: Mutex<Instant>,
    pub stop: Cancel,
}

/// A place among the open environments, which is free again when it is dropped.
pub(crate) struct Seat(Arc<App>);

impl App {
    /// What the command line does.
    ///
    /// # Errors
    ///
    /// It was not handed in.
    pub(crate) fn commands(&self) -> Result<&dyn Commands, Refusal> {
        let missing = "this program serves the page without that; use the command `swm ui`";
        self.commands.as_deref().ok_or_else(|| Refusal::new(StatusCode::NOT_IMPLEMENTED, missing))
    }

    /// A place for one more environment, if there is one.
    pub(crate) fn seat(self: &Arc<Self>) -> Option<Seat> {
        let taken = self.sessions.fetch_update(Ordering::SeqCst, Ordering::SeqCst, |open| {
            (open < self.max_sessions).then_some(open + 1)
        });
        taken.is_ok().then(|| Seat(Arc::clone(self)))
    }

    /// Lets the end of the server wait for a thread.
    pub(crate) fn keep(&self, thread: JoinHandle<()>) {
        let mut threads = self.threads.lock().unwrap_or_else(PoisonError::into_inner);
        threads.retain(|thread| !thread.is_finished());
        threads.push(thread);
    }

    /// Somebody is there.
    pub(crate) fn touch(&self) {
        *self.seen.lock().unwrap_or_else(PoisonError::into_inner) = Instant::now();
    }

    fn unseen_for(&self) -> Duration {
        self.seen.lock().unwrap_or_else(PoisonError::into_inner).elapsed()
    }
}

impl Drop for Seat {
    fn drop(&mut self) {
        self.0.sessions.fetch_sub(1, Ordering::SeqCst);
        self.0.touch();
    }
}

/// A server that has its port, and serves nothing yet.
pub struct Server {
    listener: TcpListener,
    address: SocketAddr,
    host: String,
    idle: Option<Duration>,
    app: Arc<App>,
}

impl Server {
    /// Takes the port.
    ///
    /// # Errors
    ///
    /// A path that is not there, a folder for recordings that cannot be made, a host that is no address of this machine, a
    /// port that is taken.
    pub fn bind(options: Options) -> Result<Self, UiError> {
        let Options { registry, commands, paths, save, host, port, idle, max_sessions, frame_from } = options;
        let roots = Roots::new(&paths, save.as_deref())?;
        let ip = address_of(&host)?;
        let failed = |source| UiError::Listen { address: format!("{host}:{port}"), source };
        let listener = TcpListener::bind((ip, port)).map_err(failed)?;
        let address = listener.local_addr().map_err(failed)?;
        let mut names = vec![host.clone(), ip.to_string()];
        if ip.is_loopback() {
            names.extend(["localhost", "127.0.0.1"].map(str::to_owned));
        }
        names.sort();
        names.dedup();
        let app = App {
            store: Store::new(registry.clone()),
            registry,
            commands,
            roots,
            requests: Requests::default(),
            guard: Guard::new(&names, address.port(), frame_from.as_deref())?,
            max_sessions,
            sessions: AtomicUsize::new(0),
            threads: Mutex::default(),
            seen: Mutex::new(Instant::now()),
            stop: Cancel::new(),
        };
        Ok(Self { listener, address, host, idle, app: Arc::new(app) })
    }

    /// Address and port.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// The address of the page, with the token that opens it once.
    pub fn url(&self) -> String {
        let host = if self.host.contains(':') { format!("[{}]", self.host) } else { self.host.clone() };
        format!("http://{host}:{}/?token={}", self.address.port(), self.app.guard.token())
    }

    /// Ends the server from another thread.
    pub fn stopper(&self) -> Cancel {
        self.app.stop.clone()
    }

    /// Serves until it is stopped, or nobody has looked for [`Options::idle`].
    ///
    /// # Errors
    ///
    /// [`UiError::Server`].
    pub fn run(self) -> Result<(), UiError> {
        let Self { listener, idle, app, .. } = self;
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(2)
            .max_blocking_threads(8)
            .thread_name("swm-ui")
            .enable_all()
            .build()
            .map_err(UiError::Server)?;
        let served = runtime.block_on(async {
            listener.set_nonblocking(true)?;
            let door = Door::new(tokio::net::TcpListener::from_std(listener)?);
            let router = router(Arc::clone(&app)).into_make_service_with_connect_info::<Caller>();
            tokio::select! {
                served = axum::serve(door, router).into_future() => served,
                () = ended(&app, idle) => Ok(()),
            }
        });
        // Sessions see their connections close, and commit what they hold.
        app.stop.cancel();
        app.requests.stop_all();
        runtime.shutdown_timeout(Duration::from_millis(500));
        let threads = std::mem::take(&mut *app.threads.lock().unwrap_or_else(PoisonError::into_inner));
        let started = Instant::now();
        while started.elapsed() < SAVING && threads.iter().any(|thread| !thread.is_finished()) {
            std::thread::sleep(Duration::from_millis(10));
        }
        served.map_err(UiError::Server)
    }
}

/// Binds, tells `started`, and serves until it is stopped.
///
/// # Errors
///
/// As [`Server::bind`] and [`Server::run`].
pub fn serve(options: Options, started: impl FnOnce(&Server)) -> Result<(), UiError> {
    let server = Server::bind(options)?;
    started(&server);
    server.run()
}

/// The address that a host name stands for: one of this machine, and not all of them.
fn address_of(host: &str) -> Result<IpAddr, UiError> {
    let wrong = |reason: &str| UiError::Host { host: host.to_owned(), reason: reason.to_owned() };
    let found = (host, 0).to_socket_addrs().map_err(|error| wrong(&format!("is not known: {error}")))?;
    let ip = found.map(|address| address.ip()).min_by_key(IpAddr::is_ipv6);
    match ip.ok_or_else(|| wrong("has no address"))? {
        ip if ip.is_unspecified() => Err(wrong(
            "stands for every address; name the one by which browsers reach this machine, for requests are checked against it",
        )),
        ip => Ok(ip),
    }
}

/// Waits until the server is stopped or idle.
async fn ended(app: &App, idle: Option<Duration>) {
    loop {
        tokio::time::sleep(Duration::from_millis(25)).await;
        let works = || app.sessions.load(Ordering::SeqCst) > 0 || app.requests.any_running();
        let is_idle = idle.is_some_and(|idle| app.unseen_for() >= idle && !works());
        if is_idle || app.stop.is_cancelled() {
            return;
        }
    }
}

fn router(app: Arc<App>) -> Router {
    Router::new()
        .route("/", get(|| async { assets::file("index.html") }))
        .route(
            "/assets/{name}",
            get(|axum::extract::Path(name): axum::extract::Path<String>| async move { assets::file(&name) }),
        )
        .route("/api/about", get(play::catalog::about))
        .route("/api/env", get(play::catalog::env))
        .route("/api/play", get(play::connect))
        .route("/api/files", get(results::files))
        .route("/api/result", get(results::result))
        .route("/api/training", get(results::training))
        .route("/api/job", get(results::job))
        .route("/api/requests", get(requests::list).post(requests::begin))
        .route("/api/requests/kinds", get(requests::kinds))
        .route("/api/requests/check", post(requests::check))
        .route("/api/requests/stop", post(requests::stop))
        .route("/api/manifest", post(data::make_manifest))
        .route("/api/data", get(data::about))
        .route("/api/data/episodes", get(data::episodes))
        .route("/api/data/image", get(data::image))
        .route("/api/data/video", get(data::video))
        .route("/api/data/values", get(data::values))
        .route("/api/data/sample", get(data::sample))
        .layer(DefaultBodyLimit::max(MAX_MESSAGE_BYTES))
        .layer(middleware::from_fn_with_state(Arc::clone(&app), guarded))
        .with_state(app)
}

/// Every request passes the guard, and every answer gets its headers.
async fn guarded(State(app): State<Arc<App>>, request: Request, next: Next) -> Response {
    let mut response = match app.guard.check(request.method(), request.uri(), request.headers()) {
        Ok(pass) => {
            app.touch();
            if let Some(ConnectInfo(caller)) = request.extensions().get::<ConnectInfo<Caller>>() {
                caller.is_welcome();
            }
            let mut response = next.run(request).await;
            if let Pass::New(cookie) = pass
                && let Ok(cookie) = cookie.parse()
            {
                response.headers_mut().insert(header::SET_COOKIE, cookie);
            }
            response
        }
        Err(refusal) => refusal.into_response(),
    };
    app.guard.add_headers(response.headers_mut());
    response
}
