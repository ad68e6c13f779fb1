"""Limits of what files and servers may ask of this machine, once; docs/limits.md lists them with what they keep away.

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
MAX_TRANSFORMS = 10_000
"""Maximum number of pairs of frames in a recording between which there are transforms."""

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
