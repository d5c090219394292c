"""What can be said, how it is sealed. The log's I/O is `events.store`, which nothing here imports."""

from events.chain import Chain as Chain
from events.chain import ChainBroken as ChainBroken
from events.ids import uuid_of as uuid_of
from events.kinds import KINDS as KINDS
from events.kinds import Kind as Kind
from events.kinds import Role as Role
from events.kinds import UnknownKind as UnknownKind
from events.kinds import kind_named as kind_named
from events.kinds import kind_numbered as kind_numbered
from events.kinds import kind_of as kind_of
from events.records import NO_CAUSE as NO_CAUSE
from events.records import BodyBroken as BodyBroken
from events.records import BodyRemoved as BodyRemoved
from events.records import Moment as Moment
from events.records import Record as Record
from events.records import Stored as Stored
from events.records import encode as encode
from events.records import make_record as make_record
from events.records import read_record as read_record
