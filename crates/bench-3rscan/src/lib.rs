//! MA3DSG-Bench: scenarios, metrics and reports over 3RScan and generated rooms.
