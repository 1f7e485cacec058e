!> The input of a census, a single point, and its result file: a row for each motion, in which the number of the motion, how often
!> it was found and the start that found it stand where swept values stand; estimates of its completeness are root attributes.
module hb_census_file
   use hb_census, only: census_t
   use hb_census_starts, only: start_kind_names
   use hb_document, only: document_t
   use hb_error, only: error_t
   use hb_kinds, only: wp
   use hb_model, only: model_t
   use hb_model_reader, only: read_model
   use hb_mpi, only: comm_t
   use hb_namelist, only: write_complete_text
   use hb_results, only: create_results, results_t
   use hb_results_layout, only: named_number_t, results_layout_t
   use hb_study, only: describe_layout, new_study, study_t
   use hb_text, only: string_t
   implicit none
   private
   public :: study_of_point, without_group, write_census

contains

   !> The study of one point alone, without groups &sweep and &curve; at the start of a curve.
   subroutine study_of_point(study, point, alone, error)
      type(study_t), intent(in) :: study
      integer, intent(in) :: point                                    !! from 1
      type(study_t), intent(out) :: alone
      type(error_t), allocatable, intent(out) :: error
      type(document_t), target :: document
      type(model_t) :: model
      character(:), allocatable :: text

      if (size(study%plan%parameters) == 0 .and. .not. allocated(study%plan%curve)) then
         alone = study
         return
      end if
      document = study%document
      call study%plan%apply(point, document)
      call read_model(model, document, error, study%available_memory, study%callbacks, study%purpose)  ! completes keys
      if (allocated(error)) return
      call write_complete_text(document, text)
      text = without_group(without_group(text, "sweep"), "curve")
      call new_study(alone, study%document%file_name, text, [string_t ::], error, study%available_memory)
   end subroutine study_of_point

   !> A complete input without the groups of a name: one line for each key, groups end with a separate line.
   pure function without_group(complete, name) result(text)
      character(*), intent(in) :: complete, name
      character(:), allocatable :: text
      integer :: first, last
      character(*), parameter :: line = new_line("a")

      text = complete
      do
         first = index(line//text, line//"&"//name//line)
         if (first == 0) return
         last = first + index(text(first:), line//"/"//line) + len("/")
         text = text(:first - 1)//text(last + 1:)
      end do
   end function without_group

   !> Writes the motions of a census; collective.
   subroutine write_census(study, census, path, overwrite, comm, error)
      type(study_t), intent(in) :: study                              !! of `study_of_point`
      type(census_t), intent(in) :: census                            !! with at least one motion
      character(*), intent(in) :: path
      logical, intent(in) :: overwrite
      type(comm_t), intent(in) :: comm
      type(error_t), allocatable, intent(out) :: error
      type(results_layout_t) :: layout
      type(results_t) :: results
      integer :: i, n

      n = size(study%tuples, 2)
      if (study%model%options%accuracy%grows_set) n = max(1, min(n, maxval([(census%motions(i)%result%n_harmonics, &
                                                                             i=1, size(census%motions))])))
      call describe_layout(study, 1, layout, n)
      layout%n_points = size(census%motions)
      deallocate (layout%parameters)
      allocate (layout%parameters(4))
      do i = 1, size(layout%parameters)
         layout%parameters(i)%units = "1"
      end do
      layout%parameters(1)%path = "census%motion"
      layout%parameters(1)%values = [(i - 1.0_wp, i=1, layout%n_points)]
      layout%parameters(2)%path = "census%found"
      layout%parameters(2)%values = real(census%motions%n_random, wp)
      layout%parameters(3)%path = "census%start"
      layout%parameters(3)%is_text = .true.
      layout%parameters(3)%text_values = [character(64) :: start_kind_names(census%motions%first_kind)]
      layout%parameters(4)%path = "census%mirror_of"
      layout%parameters(4)%values = census%motions%mirror_of - 1.0_wp
      associate (found => census%completeness)
         layout%numbers = [named_number_t("census_starts", real(census%n_random, wp)), &
                           named_number_t("census_lost", real(census%n_random_lost, wp)), &
                           named_number_t("census_directed_starts", real(census%n_directed, wp)), &
                           named_number_t("census_unseen", found%unseen), &
                           named_number_t("census_unseen_bound", found%unseen_bound), &
                           named_number_t("census_missed", found%missed), &
                           named_number_t("census_least_share", found%least_share), &
                           named_number_t("census_is_reliable", merge(1.0_wp, 0.0_wp, found%is_reliable))]
      end associate
      call create_results(results, path, layout, overwrite, comm, error)
      if (allocated(error)) return
      do i = 1, layout%n_points
         if (.not. allocated(error)) call results%write_point(i, census%motions(i)%result, error)
      end do
      call results%close(error)
   end subroutine write_census
end module hb_census_file
