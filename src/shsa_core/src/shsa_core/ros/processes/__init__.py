"""The processes of one computer: `local` carries out the commands of `host`."""
