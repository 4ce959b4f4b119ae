from infra.markdown import markdown_table


def test_a_bar_in_a_cell_begins_no_other():
    text = markdown_table(("name", "boxes"), [("a|b", "1"), ("c", "2")])
    assert text == "| name | boxes |\n| --- | --- |\n| a\\|b | 1 |\n| c | 2 |"
