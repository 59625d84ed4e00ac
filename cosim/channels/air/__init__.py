"""One band of 2.4 GHz for radios of any technology: what each receiver takes in of what all others send.

Begin with ``band``: the table of what is on the air, which ``emissions`` keeps in arrays for kernels, and what asks it.
``spectra`` says which share of a sender's power falls into a receiver's filter, by their kinds and centres.

A channel joins a band as a ``Tenant``. Where radios are apart each channel makes a band of its own; where they share
the air the run makes one, and all join it. The channel tells every frame that it sends, from its start to its end, asks
what interferes with a frame that it judges, and goes on as before: noise, the wanted signal and bit errors are its own.
A channel that skips idle time tells what it has skipped when the band has it catch up, and only then: alone on its band
it is never asked to.
"""
