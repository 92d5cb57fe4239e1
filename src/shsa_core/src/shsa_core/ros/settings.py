"""Times and bounds of the shells: each with its unit and its reason.

Modules name them as `settings.NAME`, so that a test can set one for all its users.
"""

# Turns: how long a thread that handles events waits at most.
TURN_S = 0.1
"""No longer between two looks at the clock: it bounds how late a message is known to have come."""

# Threads for calls that wait for others.
STANDING_WORKERS = 2
"""Always there: a call is made even where no thread can be started any more."""
IDLE_WORKER_S = 10.0
"""A thread beyond these ends when it has had nothing to do for so long."""
SAY_AGAIN_S = 10.0
"""Between two lines of the log on the same trouble."""

# Reading connections.
RECONNECT_S = 0.5
"""A node whose connection was lost counts as gone if it gives no other one within this."""
TRIES = 3
"""So often a node is asked for a connection in place of one that ended."""
REFUSAL_S = 0.002
"""A node on this computer has refused, or dropped the call, by then; any other is asked."""
LISTENED_S = 0.1
"""A node that has just listened is asked without another look."""
UNREAD_S = 0.02
"""What wakes nobody while a substitute waits for other things is read by then."""
LARGEST_MESSAGE_B = 1 << 28
"""What is larger is not kept, and its publisher counts as silent."""
READ_B = 1 << 16
"""Of one read. A smaller rest is copied: that costs less than another read."""
SHORT_READ_B = 512
"""Of the read after a message that was dropped: the next one is probably as large."""
LARGEST_DROP_B = 1 << 20
"""Dropped by one read at most."""
EXPECTED_B = 1 << 22
"""Of large messages that come before anybody need look. Linux waits for half of what a socket may
hold at most: of 6 MB, unless it was told so."""
READS_A_TURN = 16
"""Of one connection: a babbling publisher must not keep the others waiting."""

# Who is at the other end of a connection.
MOST_ASKING_MASTER = 4
"""Threads that ask the master, and no more, however many connections there are."""
ASK_MASTER_AGAIN_S = (0.5, 1.0, 2.0, 5.0, 10.0)
"""Pauses before it is asked again who is at an address that it does not list."""
MOST_KNOWN_NODES = 10_000
"""Nodes and addresses that are remembered: what strangers claim must not fill the memory."""
LARGEST_HEADER_B = 1 << 20
"""A connection header holds the message's definition."""
MOST_CALLS = 32
"""Calls to nodes at the same time: so many hung ones hold up no other."""

# Tables.
QUEUE = 200
"""Messages that wait for a slow subscriber. It misses those beyond, and then subscribes again."""
RESUBSCRIBE_S = 0.5
"""At least between two subscriptions of one table."""

# What rospy is held to.
HEADER_S = 2.0
"""So long the header of a connection to us may take, whole."""
MOST_WAITING = 100
"""Connections to us without a header at the same time; an honest one takes milliseconds."""
MOST_API_CONNECTIONS = 200
"""Connections to our XML-RPC interface at the same time."""
LARGEST_CALL_B = 32 << 20
"""Of a call to it: the SOM of a large robot, as the master tells it, has a tenth."""
EXHAUSTED_S = 0.2
"""After a lack of descriptors, threads or memory it is tried again in these pauses."""
LOG_LINES = 1000
"""So many lines wait at most; what is said beyond is lost."""
CLOSE_LOG_S = 1.0
"""At its end a node waits no longer for its last lines."""
