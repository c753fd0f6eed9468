// The report: its views, and the way from a figure to the case it came from.

view("summary", drawShares);
view("workspace", drawWorkspace);
view("case", drawCase);
view("spread", drawSpread);
view("stability", drawStability);
view("motion", drawMotion);

linkRecordings();
