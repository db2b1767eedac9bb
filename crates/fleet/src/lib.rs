//! Observation log, anti-entropy and an in-process network simulator for scene graphs.
