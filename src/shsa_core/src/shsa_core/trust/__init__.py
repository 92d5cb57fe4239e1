"""Who is believed: signatures of messages, and computers that have proved that they are ours."""
