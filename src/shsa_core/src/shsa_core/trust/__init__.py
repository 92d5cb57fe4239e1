"""Messages that are believed: their signatures, and the computers that have proved to be ours."""
