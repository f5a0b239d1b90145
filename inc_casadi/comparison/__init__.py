"""Compare controllers: what each is proved to cost, and what its competitors cannot beat."""
