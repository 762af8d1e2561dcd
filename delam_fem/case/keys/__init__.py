"""The keys of a case file: what each is, and a commented file that has them all."""
