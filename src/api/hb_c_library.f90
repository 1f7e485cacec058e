!> The functions of nhbm.h without a model: errors, versions, input keys, laws of the program. The header documents them.
module hb_c_library
   use, intrinsic :: iso_c_binding, only: c_associated, c_char, c_f_pointer, c_funptr, c_int, c_loc, c_null_char, &
      c_ptr, c_size_t
   use hb_c_handles, only: c_status, last_error, set_last_error, status_of
   use hb_c_text, only: c_text
   use hb_error, only: error_t, fail
   use hb_key_rows, only: key_row, n_key_rows
   use hb_sundials, only: has_cvode
   use hb_user_library, only: check_law_info, law_info_t, register_law_of_c, unregister_law_of_c
   use hb_version, only: git_commit, program_version, version_number
   implicit none
   private

   integer(c_int), parameter :: api_version = 1_c_int                 ! NHBM_API_VERSION
   integer, parameter :: longest_status = 40

   character(*), parameter :: nul = c_null_char
   character(33), target, save :: version_text = program_version//nul
   character(len(git_commit) + 1), target, save :: commit_text = git_commit//nul
   character(longest_status), target, save :: status_texts(0:6) = [character(longest_status) :: "success"//nul, &
      "invalid input"//nul, "invalid argument"//nul, "invalid state: it cannot be called now"//nul, &
      "the model is in use by another call"//nul, "out of memory"//nul, "unknown status"//nul]   ! of each status, negative

contains

   type(c_ptr) function nhbm_status_text(status) bind(c, name="nhbm_status_text") result(text)
      integer(c_int), value :: status
      integer :: k

      k = 6
      if (status <= 0_c_int .and. status > -6_c_int) k = -int(status)
      text = c_loc(status_texts(k))
   end function nhbm_status_text

   type(c_ptr) function nhbm_get_last_error() bind(c, name="nhbm_get_last_error") result(text)
      text = last_error()
   end function nhbm_get_last_error

   integer(c_int) function nhbm_get_api_version() bind(c, name="nhbm_get_api_version") result(version)
      version = api_version
   end function nhbm_get_api_version

   type(c_ptr) function nhbm_get_version() bind(c, name="nhbm_get_version") result(text)
      text = c_loc(version_text)
   end function nhbm_get_version

   type(c_ptr) function nhbm_get_commit() bind(c, name="nhbm_get_commit") result(commit)
      commit = c_loc(commit_text)
   end function nhbm_get_commit

   integer(c_int) function nhbm_get_version_number() bind(c, name="nhbm_get_version_number") result(number)
      number = int(version_number, c_int)
   end function nhbm_get_version_number

   integer(c_int) function nhbm_has_feature(feature) bind(c, name="nhbm_has_feature") result(has)
      type(c_ptr), value :: feature
      logical :: is_known
      integer :: i

      is_known = c_text(feature)//"|" == "cvode|" .and. has_cvode()
      do i = 1, n_key_rows()
         is_known = is_known .or. index(key_row(i), c_text(feature)//" | ") == 1
      end do
      has = merge(1_c_int, 0_c_int, is_known)
   end function nhbm_has_feature

   integer(c_size_t) function nhbm_get_key_count() bind(c, name="nhbm_get_key_count") result(n)
      n = int(n_key_rows(), c_size_t)
   end function nhbm_get_key_count

   integer(c_int) function nhbm_get_key_row(index, row, size) bind(c, name="nhbm_get_key_row") result(status)
      integer(c_size_t), value :: index, size
      type(c_ptr), value :: row
      character(*), parameter :: name = "nhbm_get_key_row"
      character(kind=c_char), pointer :: bytes(:)
      type(error_t), allocatable :: error
      character(:), allocatable :: text
      integer :: k

      text = ""
      if (.not. c_associated(row) .or. size == 0_c_size_t) then
         call fail(error, name//": row must not be NULL, and size not 0")
      else if (index < 0_c_size_t .or. index >= int(n_key_rows(), c_size_t)) then
         call fail(error, name//": index must be below nhbm_get_key_count()")
      else
         text = trim(key_row(int(index) + 1))
         if (size > 0_c_size_t .and. size < len(text, kind=c_size_t) + 1_c_size_t) then   ! a size above huge() appears negative
            call fail(error, name//": the row does not fit; NHBM_KEY_ROW_SIZE bytes are enough")
            text = ""
         end if
      end if
      status = status_of(error, c_status%invalid_argument)
      if (.not. c_associated(row) .or. size == 0_c_size_t) return
      call c_f_pointer(row, bytes, [len(text) + 1])
      do k = 1, len(text)
         bytes(k) = text(k:k)
      end do
      bytes(len(text) + 1) = c_null_char
   end function nhbm_get_key_row

   integer(c_int) function nhbm_register_law(name, info, evaluate) bind(c, name="nhbm_register_law") result(status)
      type(c_ptr), value :: name, info
      type(c_funptr), value :: evaluate
      type(law_info_t), pointer :: properties
      type(error_t), allocatable :: error

      nullify (properties)
      if (.not. (c_associated(name) .and. c_associated(info) .and. c_associated(evaluate))) then
         call fail(error, "name, info and evaluate must not be NULL")
      else
         call c_f_pointer(info, properties)
         call check_law_info(c_text(name), properties, is_registered=.true., error=error)
      end if
      if (allocated(error)) error%message = "nhbm_register_law: "//error%message
      status = status_of(error, c_status%invalid_argument)
      if (status /= c_status%success) return
      if (register_law_of_c(name, properties, evaluate) == 0) return
      status = c_status%out_of_memory
      call set_last_error("nhbm_register_law: memory is insufficient")
   end function nhbm_register_law

   integer(c_int) function nhbm_unregister_law(name) bind(c, name="nhbm_unregister_law") result(status)
      type(c_ptr), value :: name

      status = c_status%success
      if (.not. c_associated(name)) then
         status = c_status%invalid_argument
         call set_last_error("nhbm_unregister_law: name must not be NULL")
      else if (unregister_law_of_c(name) /= 0) then
         status = c_status%invalid_argument
         call set_last_error("nhbm_unregister_law: no law '"//c_text(name)//"' is registered")
      end if
   end function nhbm_unregister_law
end module hb_c_library
