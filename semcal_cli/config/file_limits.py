"""Limits of what files and servers may ask of this machine; docs/input.md lists them.

They are checked before or while something is read, so that a small hostile file takes neither minutes nor gigabytes.
"""

MAX_DOCUMENT_BYTES = 16 << 20
"""Maximum size of a document: a YAML, JSON or XML file, a list of names, or a short text. At worst, YAML of this size
takes about ten seconds and half a gigabyte to parse."""
MAX_TABLE_BYTES = 64 << 20
"""Maximum size of a text with numbers, one pose or one result per line."""

MAX_WHOLE_KEY = (1 << 32) - 1
"""Maximum whole number that is a key of a mapping, such as the id of a class. Python hashes a number by its remainder
by 2^61 - 1, so that larger ones can be chosen to fall into one place, where each is compared with all before."""
MAX_COMMAND = 4096
"""Maximum number of characters of a command of ROS in a file: splitting it into words takes the square of that."""
MAX_CAMERAS = 100
"""Maximum number of cameras of a rig, which are compared in pairs."""
MAX_FLEET_DRIVES = 10_000
"""Maximum number of drives of a fleet, each of which takes 2.5 ms."""
MAX_TRANSFORMS = 10_000
"""Maximum number of pairs of frames in a recording between which there are transforms."""

MAX_UNPACKED_BYTES = 1 << 28
"""Maximum size of a chunk or of a message of a recording, unpacked; recorders write chunks of some megabytes."""
MAX_JPEG_SCANS = 32
"""Maximum number of scans of a JPEG: encoders write up to 15, and each, however short, goes over all pixels."""
MAX_JPEG_SEGMENTS = 10_000
"""Maximum number of segments of a JPEG: full ones hold 650 MB, and files have a few dozen."""
MAX_READ_RATIO, MIN_READ_BYTES = 200, 4 << 30
"""A recording may be unpacked to this multiple of its size in all, as its parts are read several times, or to this many
bytes if that is more."""
MIN_READ_RECORDS = 10_000_000
"""Maximum number of records that are read of a recording in all, or a quarter of its bytes if that is more."""
MAX_CHUNK_RECORDS = 1 << 20
"""Maximum number of records in a chunk."""
MAX_CHUNK_DEFINITIONS = 2 << 16
"""Maximum number of schemas and channels in a chunk: the ids of each have 16 bits."""
MAX_INDEX_ENTRIES = 30_000_000
"""Maximum number of messages in the index of a ROS 1 recording: each takes 36 bytes of memory, and eight hours of a
thousand messages a second have as many."""
MAX_CONNECTIONS = 100_000
"""Maximum number of connections of a ROS 1 recording, one for each publisher of a topic."""
MAX_RECORD_HEADER, MAX_RECORD_FIELDS = 1 << 16, 64
"""Maximum size of the header of a record of ROS 1, and number of its fields; those of messages have 45 bytes."""
MAX_HELD_BYTES = 1 << 28
"""Maximum size of the messages that wait for those of other chunks at the same time."""
MAX_SUMMARY_BYTES = 1 << 26
"""Maximum size of the index of an MCAP; that of a terabyte in chunks of 4 MB has about 50 MB."""
MAX_TOPICS, MAX_TOPIC_NAME = 10_000, 4096
"""Maximum number of topics of a SQLite recording, and of characters of a name and of a type."""
MIN_ROW_BYTES = 4
"""Minimum size of a row of SQLite in its file: more rows than fit are pages that are read again and again."""
MAX_SQLITE_STEPS, SQLITE_STEPS_A_BYTE = 200_000_000, 100
"""Maximum number of instructions of SQLite for a statement, and more for each byte of the file."""
MAX_PROTOBUF_VALUES = 100_000
"""Maximum number of values of a Protobuf message besides bytes and text: each takes a hundred bytes when it is read."""
MAX_MESSAGE_TRANSFORMS = 1000
"""Maximum number of transforms in a message."""
MAX_VIDEO_PIXELS = 35_651_584
"""Maximum number of pixels of a frame of a video, that of level 6 (ITU-T H.264, table A-1): decoders hold 16."""
MAX_PIXELS_A_BYTE, MIN_VIDEO_PIXELS = 20_000, 10_000_000_000
"""A video may be decoded to so many pixels a byte in all, or to this many pixels if that is more: a frame that repeats
the one before takes a few bytes, and is decoded as any other."""
MAX_FIELDS = 128
"""Maximum number of fields of a point."""
MAX_E57_ELEMENTS = 10_000
"""Maximum number of elements of the XML of an E57: one scan has about 100, and each of its images 40. libE57 compares
each with all others of its parent."""

ANSWER_S = 30.0
"""Maximum time of an answer of a hub, and time after which a download must be faster than `MIN_BYTES_PER_S`."""
MIN_BYTES_PER_S = 100_000.0
"""Minimum speed of a download, on average."""
MAX_ANSWER_BYTES = 2 << 20
"""Maximum size of a hub's description of a network, which lists its files."""
MAX_REDIRECTS = 5
"""Maximum number of redirections of a request."""
MAX_NETWORK_FILES = 64
"""Maximum number of files of a network: the model, its parts, and the files that describe it."""
