"""What every other package uses: errors, frames, files, the YAML border, signals, progress. It knows no robots."""
