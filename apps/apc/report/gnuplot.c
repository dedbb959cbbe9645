/* SPDX-License-Identifier: BSD-3-Clause */
/*
 * Data and script go into an unnamed temporary file that becomes gnuplot's standard input, and what gnuplot
 * complains of comes back in another: no shell, no pipe that could break or fill. gnuplot runs in the folder
 * of the figure, so no path of the user's ever stands in a script.
 */
#include "gnuplot.h"

#include <errno.h>
#include <fcntl.h>
#include <locale.h>
#include <spawn.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/text.h"

/* In a gnuplot string only the single quote, @p quote, is special. */
static void put_characters(FILE *script, const char *text, char quote)
{
    char instead;

    for (size_t n; *text; text += n) {
        n = text_step(text, &instead);
        if (quote && *text == quote)
            fputc(quote, script);
        fwrite(instead ? &instead : text, 1, instead ? 1 : n, script);
    }
}

void gnuplot_characters(FILE *script, const char *text)
{
    put_characters(script, text, '\0');
}

void gnuplot_string(FILE *script, const char *variable, const char *text)
{
    fprintf(script, "%s = '", variable);
    put_characters(script, text, '\'');
    fputs("'\n", script);
}

void gnuplot_text(FILE *script, const char *array, size_t i, const char *text)
{
    fprintf(script, "%s[%zu] = '", array, i + 1);
    put_characters(script, text, '\'');
    fputs("'\n", script);
}

struct figure {
    const char *name, *part, *script; /* part: its name until it is whole */
    void (*put)(FILE *script, void *ctx);
    void *ctx;
};

/* Numbers with a point and text in UTF-8, whatever the program's locale is. */
static int write_script(FILE *script, const struct figure *f)
{
    locale_t neutral = newlocale(LC_ALL_MASK, "C.UTF-8", (locale_t)0), before;

    if (!neutral)
        return APC_ESYS;
    before = uselocale(neutral);
    fputs(figure_common, script);
    gnuplot_string(script, "file", f->part);
    f->put(script, f->ctx);
    for (int png = 0; png < 2; png++)
        fprintf(script, "png = %d\n%sunset multiplot\nunset output\n", png, f->script);
    uselocale(before);
    freelocale(neutral);
    if (fflush(script) != 0 || ferror(script) || lseek(fileno(script), 0, SEEK_SET) != 0)
        return APC_ESYS;
    return 0;
}

/* Start gnuplot in @p dir. Returns 0 or an errno. The script is named to it although it is its standard
 * input: a script without a name it would go on with after an error. */
static int spawn_gnuplot(const char *dir, FILE *script, FILE *complaints, pid_t *pid)
{
    char name[] = "gnuplot", no_user_settings[] = "-d", script_file[] = "/dev/stdin";
    char *const argv[] = {name, no_user_settings, script_file, NULL};
    posix_spawn_file_actions_t actions;
    int rc = posix_spawn_file_actions_init(&actions);

    if (rc != 0)
        return rc;
    if ((rc = posix_spawn_file_actions_addchdir_np(&actions, dir)) == 0 &&
        (rc = posix_spawn_file_actions_adddup2(&actions, fileno(script), STDIN_FILENO)) == 0 &&
        (rc = posix_spawn_file_actions_adddup2(&actions, fileno(complaints), STDERR_FILENO)) == 0)
        rc = posix_spawnp(pid, name, &actions, NULL, argv, environ);
    posix_spawn_file_actions_destroy(&actions);
    return rc;
}

/* What gnuplot gave up for, on one line: it shows the line of the script, then says
 * "/dev/stdin" line N: REASON, and sometimes more. */
static void read_complaint(FILE *complaints, char *text, size_t size)
{
    static const char position[] = "\"/dev/stdin\" line ";
    char line[200];
    size_t length = 0;

    snprintf(text, size, "it did not say why");
    rewind(complaints);
    while (fgets(line, sizeof line, complaints)) {
        const char *reason = line;

        line[strcspn(line, "\n")] = '\0';
        if (strncmp(line, position, sizeof position - 1) == 0) {
            reason = strchr(line, ':');
            length = 0;
        }
        if (reason && reason[strspn(reason, ": ")] != '\0' && length < size)
            length += (size_t)snprintf(text + length, size - length, "%s%s", length > 0 ? "; " : "",
                                       reason + strspn(reason, ": "));
    }
}

static int run_gnuplot(const char *dir, FILE *script, FILE *complaints, const char *what,
                       struct apc_error *why)
{
    char complaint[200];
    pid_t pid;
    int status, rc = spawn_gnuplot(dir, script, complaints, &pid);

    if (rc == ENOENT)
        return apc_fail(why, APC_ENOTFOUND,
                        "gnuplot, which draws %s.svg, is not installed (apt-get install gnuplot-nox)", what);
    if (rc != 0)
        return apc_fail(why, APC_ESYS, "%s: gnuplot could not be started: %s", dir, strerror(rc));
    while (waitpid(pid, &status, 0) < 0)
        if (errno != EINTR)
            return apc_fail(why, APC_ESYS, "%s: gnuplot was lost: %s", dir, strerror(errno));
    if (WIFEXITED(status) && WEXITSTATUS(status) == 0)
        return 0;
    if (WIFSIGNALED(status))
        return apc_fail(why, APC_ESYS, "%s: gnuplot was ended by signal %d", dir, WTERMSIG(status));
    read_complaint(complaints, complaint, sizeof complaint);
    return apc_fail(why, APC_ESYS, "%s: gnuplot could not draw %s.svg and %s.png: %s", dir, what, what,
                    complaint);
}

/* Nobody else who is started is to have it. */
static FILE *open_temporary(void)
{
    FILE *file = tmpfile();

    if (file)
        (void)fcntl(fileno(file), F_SETFD, FD_CLOEXEC);
    return file;
}

static int draw(const char *dir, const struct figure *f, struct apc_error *why)
{
    FILE *script = open_temporary(), *complaints = open_temporary();
    int rc = APC_ESYS;

    if (!script || !complaints)
        apc_fail(why, rc, "%s: no temporary file for gnuplot: %s", dir, strerror(errno));
    else if ((rc = write_script(script, f)) < 0)
        apc_fail(why, rc, "%s: the script for gnuplot could not be written: %s", dir, strerror(errno));
    else
        rc = run_gnuplot(dir, script, complaints, f->name, why);
    if (script)
        fclose(script);
    if (complaints)
        fclose(complaints);
    return rc;
}

/* gnuplot says nothing of a full disk. */
static bool ends_with(int folder, const char *file, const char *mark)
{
    char last[16];
    const int fd = openat(folder, file, O_RDONLY | O_CLOEXEC);
    const bool ends = fd >= 0 && lseek(fd, -(off_t)sizeof last, SEEK_END) >= 0 &&
                      read(fd, last, sizeof last) == (ssize_t)sizeof last &&
                      memmem(last, sizeof last, mark, strlen(mark));

    if (fd >= 0)
        close(fd);
    return ends;
}

/* Both files take the place of former ones where both are whole, else neither does. */
static int end_figure(const char *dir, int folder, const struct figure *f, int rc, struct apc_error *why)
{
    static const char *const suffix[] = {".svg", ".png"}, *const mark[] = {"</svg>", "IEND"};
    char part[2][260], file[260];

    for (int i = 0; i < 2; i++) {
        snprintf(part[i], sizeof part[i], "%s%s", f->part, suffix[i]);
        if (rc == 0 && !ends_with(folder, part[i], mark[i]))
            rc = apc_fail(why, APC_ESYS, "%s: %s%s could not be written whole: is there room on the disk?",
                          dir, f->name, suffix[i]);
    }
    for (int i = 0; i < 2; i++) {
        snprintf(file, sizeof file, "%s%s", f->name, suffix[i]);
        if (rc == 0 && renameat(folder, part[i], folder, file) < 0)
            rc = apc_fail(why, APC_ESYS, "%s: %s could not be written: %s", dir, file, strerror(errno));
        if (rc < 0)
            (void)unlinkat(folder, part[i], 0);
    }
    return rc;
}

int gnuplot_figure(const char *name, const char *script, void (*put)(FILE *script, void *ctx), void *ctx,
                   struct apc_error *why)
{
    const char *slash = strrchr(name, '/');
    char part[40];
    const struct figure f = {slash ? slash + 1 : name, part, script, put, ctx};

    if (!*f.name || strlen(f.name) > 250)
        return apc_fail(why, APC_EINVAL, "%s: that is no name for a figure", name);
    char *dir = slash ? strndup(name, slash == name ? 1 : (size_t)(slash - name)) : strdup(".");
    if (!dir)
        return apc_fail(why, APC_ENOMEM, "out of memory");
    snprintf(part, sizeof part, ".figure.%d.part", (int)getpid()); /* somebody else may draw it too */
    const int folder = open(dir, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    int rc = folder < 0 ? apc_fail(why, APC_ESYS, "%s: %s: a figure needs a folder that is there", dir,
                                   strerror(errno))
                        : draw(dir, &f, why);
    if (folder >= 0) {
        rc = end_figure(dir, folder, &f, rc, why);
        close(folder);
    }
    free(dir);
    return rc;
}
