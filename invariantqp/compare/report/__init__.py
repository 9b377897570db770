"""What people read: charts, tables, sentences and the page, all made from results.json."""
