"""Times and bounds of the shells: each with its unit and its reason.

Modules name them as `settings.NAME`, so that a test can set one for all its users.
"""

# Turns: how long a thread that handles events waits at most.
TURN_S = 0.1
"""No longer between two looks at the clock: it bounds how late a message is known to have come. As
often a process, and an agent, gives a sign of life: a heartbeat."""
REST_S = 0.002
"""Between two looks at least, also at a process that is waited for: what comes within this is
handled together, as of when it came; and a change of ROS time beside ours is told only then. A node
on this computer has refused a call, or dropped it, by then."""
TICK_S = 0.05
"""Between two looks for processes that end or are silent."""
LOOK_S = 1.0
"""Between two looks at what changes seldom, as the load of a computer, and two reports of them."""
ANSWER_S = 5.0
"""So long the rest of healing is given to answer, and to end: an agent, the thread that works."""
LOOKED_AT = 20
"""Nodes at each turn: for how long they have waited for a processor."""

# Threads for calls that wait for others.
STANDING_WORKERS = 2
"""There from the start: a call is made even where no thread can be started any more."""
STACK_B = 1 << 19
"""Of a thread of a substitute: rospy has one for each connection, and they count as its data."""

# Reading connections.
TRIES = 3
"""So often a node is asked for a connection in place of one that ended."""
LARGEST_MESSAGE_B = 1 << 28
"""A larger message is not kept, and its publisher counts as silent."""
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
CONSUMER_QUEUE = 10
"""Messages that wait for a consumer that does not read; the others do not wait for it."""
QUEUE = 200
"""Messages of a table that wait. A slow subscriber misses those beyond, and then begins anew."""
PAUSE_S = 0.005
"""Between two calls that are in no hurry: topics that the monitor subscribes, nodes that are
learned, registrations of what stands by. Each costs others work."""

# Who is at the other end of a connection.
MOST_ASKING_MASTER = 4
"""Threads that ask the master, and no more, however many connections there are."""
MOST_KNOWN_NODES = 10_000
"""Nodes and addresses that are remembered: what strangers claim must not fill the memory."""
LARGEST_HEADER_B = 1 << 18
"""A connection header holds the message's definition."""
MOST_CALLS = 32
"""Calls of one kind at the same time: so many hung nodes hold up no other."""

# What rospy is held to.
MOST_WAITING = 100
"""Connections to us without a header at the same time; an honest one takes milliseconds. And so
many of other users and computers to our topics, beside some to each."""
CONSUMERS_A_TOPIC = 10
MOST_API_CONNECTIONS = 200
"""Connections to our XML-RPC interface at the same time."""
LARGEST_CALL_B = 1 << 16
"""Of a call to it; all of them together so have 13 MB."""
CALLER_SHARE, CALLER_CREDIT_S = 0.02, 0.5
"""Of a processor, for each other caller and for taking their connections; s beforehand."""
LOG_LINES = 1000
"""So many lines wait at most; what is said beyond is lost."""

# Signs of life.
HUNG_BEATS = 15
"""A substitute that gave no sign of life for so many heartbeats is ended."""
STARVED = 10
"""A process that waits for a processor may be silent for so many times as long: then another one is
needed."""
HUNG_HEALER_BEATS = {"monitor": 30, "reconfigurator": 50}
"""The same of a healer that is ended by the other; they differ: one of both stays."""

# Calls, and tries again.
CALL_S = 0.5
"""So long a node is given to answer, and to give another connection in place of a lost one; and so
long an answer holds, as of the master, who publishes what."""
PATIENCE_S = 2.0
"""So long somebody is given who may take a while: the master of a large robot to answer, anybody to
say who connects to us, a process to begin or to end, a log to take its last lines; and between two
looks at where everybody is, and at the parameters."""
FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.5, 60.0
"""Between two tries of what fails, as of a fork, or a table: it doubles each time. The longest is
between two log lines on the same trouble or sender as well, and how long a substitute goes on
without a reconfigurator, which a launch starts again within 2 s."""

# Agents on other computers.
LOST_BEATS = 10
"""An agent that is silent for so many heartbeats cannot be reached, and its computer is lost."""
RETURN_BEATS = 40
"""An agent that has ended is started again within this time: its computer is there."""

# The master.
MASTER_LOOK_S = 0.25
"""Between two looks at the master and at shsa/som: what is new counts within a second."""
LOOKING_SHARE = 0.02
"""Of the time at most this much goes into looking: it takes long on a large robot."""
INTRODUCTION_LOOKS = (1, 4, 12)
"""At so many of them after a publisher has come; the master takes 0.1 s, a connection a moment."""
