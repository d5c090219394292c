"""All I/O of the log. Never imported by `events`, by statecharts, or by the folds of projections."""

from events.store.flights import Flight as Flight
from events.store.flights import create_flight as create_flight
from events.store.flights import flights_in as flights_in
from events.store.flights import open_flight as open_flight
from events.store.flights import read_flight as read_flight
from events.store.flights import remove_begun as remove_begun
from events.store.memory import MemoryStore as MemoryStore
from events.store.protocol import Appender as Appender
from events.store.protocol import Head as Head
from events.store.protocol import Reader as Reader
from events.store.protocol import StoreFailed as StoreFailed
from events.store.protocol import StoreMissing as StoreMissing
from events.store.sqlite import SqliteReader as SqliteReader
from events.store.sqlite import SqliteStore as SqliteStore
