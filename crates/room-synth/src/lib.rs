//! Generated furnished rooms, rescans, camera paths and depth frames in 3RScan's form.
