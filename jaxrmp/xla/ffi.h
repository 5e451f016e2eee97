/* Calls the function `program`, which stands before, as XLA's foreign function `program_ffi`: the states of a batch in
   ranges, on XLA's threads. */

#include <stdatomic.h>
#include <sched.h>

#include "xla/ffi/api/c_api.h"

#define AT_LEAST (4 * LANES) /* states of a range: fewer are not worth a thread */

typedef struct {
    atomic_long next, done, users;
    atomic_int failed;
    long states, step, ranges;
    const void **in;
    void **out;
} Batch;

static void leave(Batch *batch) {
    if (atomic_fetch_sub(&batch->users, 1) == 1) free(batch);
}

static void work(Batch *batch) {
    for (;;) {
        long k = atomic_fetch_add(&batch->next, 1);
        if (k >= batch->ranges) return; /* what `in` and `out` point to may be gone */
        long first = k * batch->step, last = first + batch->step;
        if (last > batch->states) last = batch->states;
        if (program(batch->in, batch->out, first, last)) atomic_store(&batch->failed, 1);
        atomic_fetch_add(&batch->done, 1);
    }
}

static void task(void *data) {
    work(data);
    leave(data);
}

static XLA_FFI_Error *error(const XLA_FFI_Api *api, const char *message) {
    XLA_FFI_Error_Create_Args args = {XLA_FFI_Error_Create_Args_STRUCT_SIZE, NULL, message,
                                      XLA_FFI_Error_Code_RESOURCE_EXHAUSTED};
    return api->XLA_FFI_Error_Create(&args);
}

XLA_FFI_Error *program_ffi(XLA_FFI_CallFrame *frame) {
    /* The first of the chain is read as this; what its base is called differs between versions. */
    XLA_FFI_Metadata_Extension *extension = (XLA_FFI_Metadata_Extension *)frame->extension_start;
    if (extension && extension->extension_base.type == XLA_FFI_Extension_Metadata) {
        XLA_FFI_Metadata *metadata = extension->metadata;
        metadata->api_version.major_version = XLA_FFI_API_MAJOR;
        metadata->api_version.minor_version = XLA_FFI_API_MINOR;
        return NULL;
    }
    if (frame->stage != XLA_FFI_ExecutionStage_EXECUTE) return NULL;
    const void *in[frame->args.size + 1];
    void *out[frame->rets.size + 1];
    for (int64_t k = 0; k < frame->args.size; k++) in[k] = ((XLA_FFI_Buffer *)frame->args.args[k])->data;
    for (int64_t k = 0; k < frame->rets.size; k++) out[k] = ((XLA_FFI_Buffer *)frame->rets.rets[k])->data;
    long states = ((XLA_FFI_Buffer *)frame->rets.rets[0])->dims[0];

    int64_t threads = 1;
    XLA_FFI_ThreadPool_NumThreads_Args number = {XLA_FFI_ThreadPool_NumThreads_Args_STRUCT_SIZE, NULL, frame->ctx,
                                                 &threads};
    XLA_FFI_Error *none = frame->api->XLA_FFI_ThreadPool_NumThreads(&number);
    if (none || threads < 1) threads = 1;
    long ranges = states / AT_LEAST < 4 * threads ? states / AT_LEAST : 4 * threads;
    if (threads == 1 || ranges < 2) {
        return program(in, out, 0, states) ? error(frame->api, "out of memory") : NULL;
    }
    Batch *batch = malloc(sizeof(Batch));
    if (!batch) return error(frame->api, "out of memory");
    long step = ((states + ranges - 1) / ranges + LANES - 1) / LANES * LANES;
    ranges = (states + step - 1) / step;
    atomic_init(&batch->next, 0);
    atomic_init(&batch->done, 0);
    atomic_init(&batch->failed, 0);
    atomic_init(&batch->users, 1);
    batch->states = states, batch->step = step, batch->ranges = ranges, batch->in = in, batch->out = out;
    for (long t = 1; t < threads && t < ranges; t++) {
        atomic_fetch_add(&batch->users, 1);
        XLA_FFI_ThreadPool_Schedule_Args args = {XLA_FFI_ThreadPool_Schedule_Args_STRUCT_SIZE, NULL, frame->ctx, task,
                                                 batch};
        if (frame->api->XLA_FFI_ThreadPool_Schedule(&args)) {
            leave(batch);
            break;
        }
    }
    work(batch);
    while (atomic_load(&batch->done) < ranges) sched_yield();
    int failed = atomic_load(&batch->failed);
    leave(batch);
    return failed ? error(frame->api, "out of memory") : NULL;
}
