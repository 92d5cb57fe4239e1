"""The processes of one computer: `local` carries out the commands of `host`.

`nodes` knows which process a node is, `kernel` asks the kernel; `starting` starts substitutes,
`restarting` nodes that failed; `watching` hears by `heartbeats` who is alive.
"""
