//! Connections that have not shown the token or the cookie: they are closed after a while, and there are only so many of them, so that
//! nobody else who reaches the port can keep the owner of the page from it.

use std::collections::VecDeque;
use std::future::Future as _;
use std::io;
use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::task::{Context, Poll, Waker};
use std::time::{Duration, Instant};

use axum::extract::connect_info::Connected;
use axum::serve::{IncomingStream, Listener};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::{TcpListener, TcpStream};
use tokio::time::Sleep;

/// So long a connection may be open without a request of somebody who may see the page.
const PATIENCE: Duration = Duration::from_secs(10);
/// So many such connections stay open; beyond, the oldest is closed. Browsers open about six.
const MAX_STRANGERS: usize = 24;
/// A connection this young is not closed for a younger one, as its first request may be on its way: the owner's, too.
const GRACE: Duration = Duration::from_secs(1);
/// So many are open in any case, of whatever age.
const MOST_STRANGERS: usize = 512;
/// Until a connection that is closed has given back its file.
const CLOSING: Duration = Duration::from_millis(10);

/// An open connection.
#[derive(Debug, Default)]
struct Connection {
    is_known: AtomicBool,
    is_closed: AtomicBool,
    /// Who waits for bytes of it.
    reader: Mutex<Option<Waker>>,
}

impl Connection {
    fn close(&self) {
        self.is_closed.store(true, Ordering::SeqCst);
        let reader = self.reader.lock().unwrap_or_else(PoisonError::into_inner).take();
        if let Some(reader) = reader {
            reader.wake();
        }
    }
}

/// What a request knows of its connection.
#[derive(Clone, Debug)]
pub(crate) struct Caller(Arc<Connection>);

impl Caller {
    /// Somebody who may see the page has asked through it: it stays open.
    pub(crate) fn is_welcome(&self) {
        self.0.is_known.store(true, Ordering::SeqCst);
    }
}

impl Connected<IncomingStream<'_, Door>> for Caller {
    fn connect_info(stream: IncomingStream<'_, Door>) -> Self {
        Self(Arc::clone(&stream.io().connection))
    }
}

/// Accepts connections.
pub(crate) struct Door {
    listener: TcpListener,
    strangers: VecDeque<(Instant, Weak<Connection>)>,
}

impl Door {
    pub(crate) fn new(listener: TcpListener) -> Self {
        Self { listener, strangers: VecDeque::new() }
    }

    fn admit(&mut self, stream: TcpStream) -> Stream {
        self.forget_the_known();
        while self.strangers.len() >= MAX_STRANGERS
            && let Some((begun, _)) = self.strangers.front()
            && (begun.elapsed() >= GRACE || self.strangers.len() >= MOST_STRANGERS)
        {
            self.close_the_oldest();
        }
        let connection = Arc::new(Connection::default());
        self.strangers.push_back((Instant::now(), Arc::downgrade(&connection)));
        Stream { stream, connection, patience: Box::pin(tokio::time::sleep(PATIENCE)) }
    }

    /// Of those that are still open, the ones without a request of somebody who may see the page remain.
    fn forget_the_known(&mut self) {
        self.strangers
            .retain(|(_, open)| open.upgrade().is_some_and(|open| !open.is_known.load(Ordering::SeqCst)));
    }

    fn close_the_oldest(&mut self) {
        if let Some(oldest) = self.strangers.pop_front().and_then(|(_, oldest)| oldest.upgrade()) {
            oldest.close();
        }
    }
}

impl Listener for Door {
    type Io = Stream;
    type Addr = SocketAddr;

    async fn accept(&mut self) -> (Stream, SocketAddr) {
        loop {
            match self.listener.accept().await {
                Ok((stream, address)) => return (self.admit(stream), address),
                Err(error) if is_of_the_peer(&error) => {}
                // The process may open no more files: strangers give theirs back, of whatever age they are.
                Err(_) => {
                    self.forget_the_known();
                    let keep = self.strangers.len().saturating_sub(1).min(MAX_STRANGERS);
                    while self.strangers.len() > keep {
                        self.close_the_oldest();
                    }
                    tokio::time::sleep(CLOSING).await;
                }
            }
        }
    }

    fn local_addr(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }
}

/// Whether a connection ended before it was accepted.
fn is_of_the_peer(error: &io::Error) -> bool {
    use io::ErrorKind::{ConnectionAborted, ConnectionRefused, ConnectionReset};
    matches!(error.kind(), ConnectionAborted | ConnectionRefused | ConnectionReset)
}

/// The bytes of a connection.
pub(crate) struct Stream {
    stream: TcpStream,
    connection: Arc<Connection>,
    patience: Pin<Box<Sleep>>,
}

impl AsyncRead for Stream {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        if !self.connection.is_known.load(Ordering::SeqCst) {
            let reader = context.waker().clone();
            *self.connection.reader.lock().unwrap_or_else(PoisonError::into_inner) = Some(reader);
            let is_late = self.patience.as_mut().poll(context).is_ready();
            if is_late || self.connection.is_closed.load(Ordering::SeqCst) {
                return Poll::Ready(Err(io::ErrorKind::TimedOut.into()));
            }
        }
        Pin::new(&mut self.stream).poll_read(context, buffer)
    }
}

impl AsyncWrite for Stream {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.stream).poll_write(context, bytes)
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(context)
    }
}
