/* The tables of fields.h as Python sees them: types whose objects are made by name and never change, and functions that
   are called by name. */

#include "boundary.h"
#include "loop.h"

#define NEEDED NAN
#define NOTHING (-INFINITY)
#define DEFAULT(value) (value)
/* More fields than any table has. */
#define MOST_FIELDS 40
#define MOST_WORDS 6

typedef enum { A_NUMBER, A_COUNT, A_FLAG, A_WORD, A_LENGTH, A_VECTOR, A_MATRIX, AN_OBJECT, OBJECTS_OF, A_TUPLE } FieldKind;

/* A side of an array is a number, or -1 - where in the struct its length is. */
typedef struct {
    const char *name, *meaning;
    FieldKind kind;
    size_t offset;
    long given; /* where a bool says whether it is, -1 for none */
    int rows, columns, most_rows, width;
    double fallback;
    const char *words[MOST_WORDS]; /* and NULL after the last */
    Table *of;
} Field;

struct Table {
    const char *name, *does;
    size_t size;
    const Field *(*fields_of)(void), *fields;
    bool (*settled)(const void *values); /* whether all of it goes together */
    PyTypeObject *type;
    PyObject *names[MOST_FIELDS]; /* as Python has them */
    PyGetSetDef getters[MOST_FIELDS];
};

#define SIDE_3 3
#define SIDE_4 4
#define SIDE_6 6
#define SIDE_joints (-1 - (int)offsetof(OF, joints))
#define SIDE_n (-1 - (int)offsetof(OF, n))
#define SIDE_m (-1 - (int)offsetof(OF, m))
#define SIDE_wanted (-1 - (int)offsetof(OF, wanted))
#define SIDE_rows (-1 - (int)offsetof(OF, rows))
#define SIDE_limits (-1 - (int)offsetof(OF, limits))
#define SIDE_twists (-1 - (int)offsetof(OF, twists))
#define NUMBER(name, by, does) {#name, does, A_NUMBER, offsetof(OF, name), -1, 1, 1, 1, 1, by, {NULL}, NULL},
#define COUNT(name, by, does) {#name, does, A_COUNT, offsetof(OF, name), -1, 1, 1, 1, 1, by, {NULL}, NULL},
#define FLAG(name, by, does) {#name, does, A_FLAG, offsetof(OF, name), -1, 1, 1, 1, 1, by, {NULL}, NULL},
#define WORD(name, words, by, does) WORD_OF(name, by, does, words)
#define WORD_OF(name, by, does, ...) \
    {#name, does, A_WORD, offsetof(OF, name), -1, 1, 1, 1, 1, by, {__VA_ARGS__, NULL}, NULL},
#define LENGTH(name, most, does) {#name, does, A_LENGTH, offsetof(OF, name), -1, 1, 1, most, 1, 0.0, {NULL}, NULL},
#define VECTOR(name, n, by, does) \
    {#name, does, A_VECTOR, offsetof(OF, name), -1, SIDE_##n, 1, ROOM_##n, 1, by, {NULL}, NULL},
#define MATRIX(name, rows, columns, by, does) \
    {#name, does, A_MATRIX, offsetof(OF, name), -1, SIDE_##rows, SIDE_##columns, ROOM_##rows, ROOM_##columns, by, {NULL}, NULL},
#define MAYBE_VECTOR(name, n, given, does) \
    {#name, does, A_VECTOR, offsetof(OF, name), offsetof(OF, given), SIDE_##n, 1, ROOM_##n, 1, 0.0, {NULL}, NULL},
#define MAYBE_MATRIX(name, rows, columns, given, does)                                                               \
    {#name,        does,    A_MATRIX, offsetof(OF, name), offsetof(OF, given), SIDE_##rows, SIDE_##columns, ROOM_##rows, \
     ROOM_##columns, NOTHING, {NULL}, NULL},
#define OBJECT(name, type, does) {#name, does, AN_OBJECT, offsetof(OF, name), -1, 1, 1, 1, 1, NEEDED, {NULL}, &TABLE_##type},
#define OBJECTS(name, type, length, does) \
    {#name, does, OBJECTS_OF, offsetof(OF, name), -1, SIDE_##length, 1, ROOM_##length, 1, NOTHING, {NULL}, &TABLE_##type},
#define TUPLE(name, by, does) {#name, does, A_TUPLE, offsetof(OF, name), -1, 1, 1, 1, 1, by, {NULL}, NULL},
#define END {NULL, NULL, A_LENGTH, 0, -1, 0, 0, 0, 0, 0.0, {NULL}, NULL}

static PyObject *EMPTY; /* a tuple; made with the types */

static bool law_settled(const void *values)
{
    const Law *law = values;
    return law->form != COMPLEMENT || law->twists > 0;
}

static bool loop_settled(const void *values)
{
    const Loop *loop = values;
    int m = loop->joints;
    for (int i = 0; i < loop->wanted; i++)
        if (loop->exact[i].kind == JOINTS && loop->exact[i].joints != m)
            return false;
    return loop->dt > 0.0 && loop->delay >= 0.0 && loop->delay <= MOST_LATE * loop->dt && loop->row_rank >= -1 &&
           (!loop->law.has_metric || loop->law.joints == m);
}

/* A table under a name for C, and what Python calls it: a type, or the fields of a call. */
#define TABLE(id, struct_, list, called, does_, settled_)                                                          \
    static const Field *fields_of_##id(void)                                                                        \
    {                                                                                                               \
        typedef struct_ OF;                                                                                         \
        static const Field FIELDS[] = {list END};                                                                   \
        return FIELDS;                                                                                              \
    }                                                                                                               \
    Table TABLE_##id = {.name = called, .does = does_, .size = sizeof(struct_), .fields_of = fields_of_##id, .settled = settled_};

TABLE(Law, Law, LAW_FIELDS, "Law", "What of a law does not change from tick to tick.", law_settled)
TABLE(Wanted, Wanted, WANTED_FIELDS, "Wanted", "An exact demand of a loop.", NULL)
TABLE(Loop, Loop, LOOP_FIELDS, "Loop", "What of a controller does not change from tick to tick.", loop_settled)
TABLE(now, Now, NOW_FIELDS, "step", "", NULL)
TABLE(tick, Demand, TICK_FIELDS, "tick", "", NULL)

/* An object of a table: its struct after the head that Python needs. */
typedef struct {
    PyObject_HEAD
    double values[];
} Described;

/* The struct of an object that was made by this table; NULL, and no error, for anything else. */
const void *described(const Table *table, PyObject *object)
{
    return Py_TYPE(object) == table->type ? ((Described *)object)->values : NULL;
}

/* Whether a side of an array is as long as its rule says; a length that is not known yet becomes it. */
static bool agrees(char *values, int rule, npy_intp found, int most)
{
    if (rule >= 0)
        return found == rule;
    int *length = (int *)(values + (-1 - rule));
    if (*length == 0 && found <= most)
        *length = (int)found;
    return *length == found;
}

/* How long an array, a list or a tuple, of rows where there are columns, is along an axis; -1 for anything else. */
static npy_intp size_along(PyObject *object, int axis)
{
    if (PyArray_Check(object))
        return PyArray_NDIM((PyArrayObject *)object) > axis ? PyArray_DIM((PyArrayObject *)object, axis) : -1;
    bool list = PyList_Check(object);
    if (!list && !PyTuple_Check(object))
        return -1;
    Py_ssize_t size = list ? PyList_Size(object) : PyTuple_Size(object);
    if (axis == 0)
        return size;
    return size == 0 ? -1 : size_along(list ? PyList_GetItem(object, 0) : PyTuple_GetItem(object, 0), axis - 1);
}

static bool array_taken(const Field *field, PyObject *object, char *values)
{
    bool flat = field->kind == A_VECTOR;
    npy_intp rows = size_along(object, 0), columns = flat ? 0 : size_along(object, 1);
    if (rows < 0 || columns < 0 || !agrees(values, field->rows, rows, field->most_rows) ||
        (!flat && !agrees(values, field->columns, columns, field->width)))
        return false;
    double *into = (double *)(values + field->offset);
    return flat ? vector(object, (int)rows, into) : matrix(object, (int)rows, (int)columns, field->width, into);
}

static bool objects_taken(const Field *field, PyObject *object, char *values)
{
    const Table *of = field->of;
    if (!PyTuple_Check(object) || !agrees(values, field->rows, PyTuple_Size(object), field->most_rows))
        return false;
    for (Py_ssize_t i = 0; i < PyTuple_Size(object); i++) {
        const void *found = described(of, PyTuple_GetItem(object, i));
        if (found == NULL)
            return false;
        memcpy(values + field->offset + (size_t)i * of->size, found, of->size);
    }
    return true;
}

/* Write a field; false, and perhaps an error, where it is not as it has to be. */
static bool taken(const Field *field, PyObject *object, char *values)
{
    char *into = values + field->offset;
    if (field->given >= 0)
        *(bool *)(values + field->given) = true;
    switch (field->kind) {
    case A_NUMBER:
        *(double *)into = PyFloat_AsDouble(object);
        return !PyErr_Occurred();
    case A_COUNT:
        *(int *)into = (int)PyLong_AsLong(object);
        return !PyErr_Occurred();
    case A_FLAG:
        *(bool *)into = object == Py_True;
        return PyBool_Check(object);
    case A_WORD:
        for (int i = 0; PyUnicode_Check(object) && field->words[i] != NULL; i++)
            if (PyUnicode_CompareWithASCIIString(object, field->words[i]) == 0) {
                *(int *)into = i;
                return true;
            }
        return false;
    case AN_OBJECT: {
        const void *found = described(field->of, object);
        if (found != NULL)
            memcpy(into, found, field->of->size);
        return found != NULL;
    }
    case OBJECTS_OF:
        return objects_taken(field, object, values);
    case A_TUPLE: /* borrowed; an object of a table owns its own */
        *(void **)into = object;
        return PyTuple_Check(object);
    case A_LENGTH:
        return false;
    default:
        return array_taken(field, object, values);
    }
}

/* What a field is where it is not given; false where it has to be. */
static bool left_out(const Field *field, char *values)
{
    char *into = values + field->offset;
    if (field->given >= 0)
        *(bool *)(values + field->given) = false;
    if (isnan(field->fallback))
        return false;
    if (field->kind == A_NUMBER)
        *(double *)into = field->fallback;
    else if (field->kind == A_COUNT || field->kind == A_WORD)
        *(int *)into = (int)field->fallback;
    else if (field->kind == A_FLAG)
        *(bool *)into = field->fallback != 0.0;
    else if (field->kind == A_TUPLE)
        *(void **)into = EMPTY;
    for (int i = 0; field->kind == A_VECTOR && field->fallback != NOTHING && i < field->most_rows; i++)
        ((double *)into)[i] = field->fallback;
    return true;
}

/* Read what was given by name into a struct. UNFIT is an array of another kind, about which Python has words; WRONG has an
   error. */
static Fit by_name(Table *table, PyObject *const *given, PyObject *const *names, Py_ssize_t count, void *into)
{
    bool known[MOST_FIELDS] = {false};
    char *values = into;
    Fit fit = FITS;
    int at = 0;
    for (const Field *field = table->fields; field->name != NULL; field++)
        if (field->kind == A_LENGTH)
            *(int *)(values + field->offset) = 0;
    for (Py_ssize_t k = 0; k < count; k++) {
        int fields = 0, found = -1;
        for (; table->names[fields] != NULL; fields++)
            ;
        for (int tried = 0; tried < fields && found < 0; tried++, at = (at + 1) % fields) /* most come in order */
            if (names[k] == table->names[at])
                found = at;
        for (int i = 0; i < fields && found < 0; i++) /* a name that is not interned */
            if (PyUnicode_Compare(names[k], table->names[i]) == 0)
                found = i;
        if (found < 0 || table->fields[found].kind == A_LENGTH) {
            PyErr_Format(PyExc_TypeError, "%s() takes no %R", table->name, names[k]);
            return WRONG;
        }
        const Field *field = &table->fields[found];
        if (given[k] == Py_None && !isnan(field->fallback))
            continue;
        known[found] = true;
        if (taken(field, given[k], values))
            continue;
        if (!PyErr_Occurred() && (field->kind == A_VECTOR || field->kind == A_MATRIX)) {
            fit = UNFIT;
            continue;
        }
        PyErr_Format(PyExc_TypeError, "%s(%U=...) does not take %R: %s", table->name, names[k], given[k], field->meaning);
        return WRONG;
    }
    for (int i = 0; table->names[i] != NULL; i++)
        if (!known[i] && !left_out(&table->fields[i], values)) {
            PyErr_Format(PyExc_TypeError, "%s(%U=...) is missing: %s", table->name, table->names[i], table->fields[i].meaning);
            return WRONG;
        }
    return fit;
}

/* The same for a call: values after the positional ones, and a tuple of their names or NULL. */
Fit called_by_name(Table *table, PyObject *const *given, PyObject *names, void *into)
{
    PyObject *name[MOST_FIELDS];
    Py_ssize_t count = names == NULL ? 0 : PyTuple_Size(names);
    for (Py_ssize_t i = 0; i < count && i < MOST_FIELDS; i++)
        name[i] = PyTuple_GetItem(names, i);
    return by_name(table, given, name, count < MOST_FIELDS ? count : MOST_FIELDS, into);
}


static Table *const TABLES[] = {&TABLE_Law, &TABLE_Wanted, &TABLE_Loop};
#define TYPES ((int)(sizeof TABLES / sizeof *TABLES))

static Table *table_of(const PyTypeObject *type)
{
    for (int i = 0; i < TYPES; i++)
        if (TABLES[i]->type == type)
            return TABLES[i];
    return NULL;
}

static PyObject *allocated(const Table *table)
{
    return ((allocfunc)PyType_GetSlot(table->type, Py_tp_alloc))(table->type, 0);
}

/* Own the tuples of a struct, or let them go. */
static void hold(const Table *table, char *values, bool owned)
{
    for (const Field *field = table->fields; field->name != NULL; field++)
        if (field->kind == A_TUPLE && owned)
            Py_XINCREF(*(PyObject **)(values + field->offset));
        else if (field->kind == A_TUPLE)
            Py_XDECREF(*(PyObject **)(values + field->offset));
}

static void let_go(PyObject *self)
{
    PyTypeObject *type = Py_TYPE(self);
    hold(table_of(type), (char *)((Described *)self)->values, false);
    ((freefunc)PyType_GetSlot(type, Py_tp_free))(self);
    Py_DECREF(type);
}

static PyObject *made(PyTypeObject *type, PyObject *positional, PyObject *by_their_names)
{
    Table *table = table_of(type);
    PyObject *given[MOST_FIELDS], *names[MOST_FIELDS], *name, *value;
    Py_ssize_t place = 0, count = 0;
    if (PyTuple_Size(positional) != 0)
        return PyErr_Format(PyExc_TypeError, "%s() takes its fields by name", table->name);
    while (by_their_names != NULL && count < MOST_FIELDS && PyDict_Next(by_their_names, &place, &name, &value)) {
        names[count] = name;
        given[count++] = value;
    }
    PyObject *self = allocated(table);
    if (self == NULL)
        return NULL;
    void *values = ((Described *)self)->values;
    Fit fit = by_name(table, given, names, count, values);
    hold(table, values, true);
    if (fit == FITS && (table->settled == NULL || table->settled(values)))
        return self;
    if (fit != WRONG)
        PyErr_Format(PyExc_TypeError, "%s(): an array of another shape or kind, or fields that do not go together",
                     table->name);
    Py_DECREF(self);
    return NULL;
}

static PyObject *value_of(const Field *field, const char *values)
{
    const char *from = values + field->offset;
    int rows = field->rows >= 0 ? field->rows : *(const int *)(values + (-1 - field->rows));
    int columns = field->columns >= 0 ? field->columns : *(const int *)(values + (-1 - field->columns));
    if (field->given >= 0 && !*(const bool *)(values + field->given))
        Py_RETURN_NONE;
    switch (field->kind) {
    case A_NUMBER:
        return PyFloat_FromDouble(*(const double *)from);
    case A_COUNT:
    case A_LENGTH:
        return PyLong_FromLong(*(const int *)from);
    case A_FLAG:
        return PyBool_FromLong(*(const bool *)from);
    case A_WORD:
        return PyUnicode_FromString(field->words[*(const int *)from]);
    case A_TUPLE:
        return Py_NewRef(*(PyObject *const *)from);
    case A_VECTOR:
        return new_vector(rows, (const double *)from);
    case A_MATRIX:
        return new_matrix(rows, columns, field->width, (const double *)from);
    default:
        break;
    }
    PyObject *tuple = field->kind == OBJECTS_OF ? PyTuple_New(rows) : NULL;
    for (int i = 0; i < rows; i++) {
        PyObject *one = allocated(field->of);
        if (one == NULL)
            return NULL;
        memcpy(((Described *)one)->values, from + (size_t)i * field->of->size, field->of->size);
        if (field->kind == AN_OBJECT)
            return one;
        PyTuple_SetItem(tuple, i, one);
    }
    return tuple;
}

static PyObject *field_of(PyObject *self, void *field) { return value_of(field, (const char *)((Described *)self)->values); }

/* Its fields by name, from which `pickle` makes another one. */
static PyObject *new_arguments(PyObject *self, PyObject *nothing)
{
    (void)nothing;
    const Table *table = table_of(Py_TYPE(self));
    PyObject *found = PyDict_New();
    for (int i = 0; found != NULL && table->names[i] != NULL; i++) {
        if (table->fields[i].kind == A_LENGTH)
            continue;
        PyObject *value = field_of(self, (void *)&table->fields[i]);
        if (value == NULL || PyDict_SetItem(found, table->names[i], value) < 0)
            return NULL;
        Py_DECREF(value);
    }
    return Py_BuildValue("(()N)", found);
}

/* It does not change, so a copy is itself. */
static PyObject *itself(PyObject *self, PyObject *memo)
{
    (void)memo;
    return Py_NewRef(self);
}

static PyMethodDef METHODS_OF_ALL[] = {
    {"__getnewargs_ex__", new_arguments, METH_NOARGS, NULL},
    {"__copy__", itself, METH_NOARGS, NULL},
    {"__deepcopy__", itself, METH_O, NULL},
    {NULL, NULL, 0, NULL},
};

static bool named_fields(Table *table)
{
    table->fields = table->fields_of();
    for (int i = 0; table->fields[i].name != NULL; i++) {
        char name[64];
        PyOS_snprintf(name, sizeof name, "%s", table->fields[i].name);
        for (char *letter = name; *letter != 0; letter++)
            *letter = *letter == '.' ? '_' : *letter;
        table->names[i] = PyUnicode_InternFromString(name);
        if (table->names[i] == NULL)
            return false;
    }
    return true;
}

/* The types of all tables, into the module. */
bool types_made(PyObject *module)
{
    EMPTY = PyTuple_New(0);
    bool good = EMPTY != NULL && named_fields(&TABLE_tick) && named_fields(&TABLE_now);
    for (int t = 0; good && t < TYPES; t++) {
        Table *table = TABLES[t];
        good = named_fields(table);
        for (int i = 0; table->fields[i].name != NULL; i++)
            table->getters[i] = (PyGetSetDef){table->fields[i].name, field_of, NULL, table->fields[i].meaning, (void *)&table->fields[i]};
        PyType_Slot slots[] = {{Py_tp_new, made},           {Py_tp_getset, table->getters}, {Py_tp_methods, METHODS_OF_ALL},
                               {Py_tp_dealloc, let_go},  {Py_tp_doc, (void *)table->does},   {0, NULL}};
        char name[64];
        PyOS_snprintf(name, sizeof name, "invariantqp._native.%s", table->name);
        PyType_Spec spec = {name, (int)(offsetof(Described, values) + table->size), 0, Py_TPFLAGS_DEFAULT, slots};
        PyObject *type = good ? PyType_FromSpec(&spec) : NULL;
        table->type = (PyTypeObject *)type;
        good = type != NULL && PyModule_AddObject(module, table->name, Py_NewRef(type)) == 0;
    }
    return good;
}
