!> The location of the result of a verb: the target of a link, never the input or a model.
module result_location
   use arguments, only: arguments_t
   use hb_error, only: error_t, fail
   use hb_fe_model_file, only: is_model_file
   use hb_mpi, only: broadcast_text, comm_t, rank_of, share_error
   use hb_operating_system, only: follow_links, is_same_file
   implicit none
   private
   public :: place_result

   !> Endings of names of other formats, which a result does not have.
   character(5), parameter :: other_endings(9) = [character(5) :: ".csv", ".txt", ".dat", ".nml", ".mat", ".png", ".pdf", ".html", &
                                                  ".xlsx"]

contains

   !> Returns the path of the result file, the same on all ranks; collective.
   subroutine place_result(options, comm, path, error)
      type(arguments_t), intent(in) :: options
      type(comm_t), intent(in) :: comm
      character(:), allocatable, intent(out) :: path
      type(error_t), allocatable, intent(out) :: error

      if (rank_of(comm) == 0) then
         call follow_links(options%result_path(), path)
         if (is_same_file(path, options%input)) then
            call fail(error, "result file '"//path//"' is the input file; give another --output")
            if (index(path, ".h5", back=.true.) == max(1, len(path) - 2)) error%message = error%message// &
               "; if it is a result already: nhbm info describes it, nhbm resume continues it"
         end if
         if (has_other_format(path) .and. .not. allocated(error)) &
            call fail(error, "result file '"//path//"' would be HDF5: give an --output that ends in .h5; nhbm-post draws it "// &
                      "and writes tables, such as by nhbm-post response RESULT -o TABLE.csv")
         if (.not. allocated(error)) then
            if (is_model_file(path)) call fail(error, "result file '"//path//"' is a model file; give another --output")
         end if
      end if
      call share_error(comm, error)
      if (.not. allocated(error)) call broadcast_text(comm, path, 0)
   end subroutine place_result

   !> Whether a name ends like files of other formats.
   pure logical function has_other_format(path)
      character(*), intent(in) :: path
      integer :: dot

      dot = index(path, ".", back=.true.)
      has_other_format = .false.
      if (dot > 0) has_other_format = any(other_endings == path(dot:))
   end function has_other_format
end module result_location
