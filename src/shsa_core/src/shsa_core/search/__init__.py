"""The best derivation of a lost property; all of them; the first found."""
